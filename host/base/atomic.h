/* SC_ATOMIC(type): an atomic member of a public struct. C11 atomics have no C++17 name, but C++
 * shims only carry pointers to such structs: for them the plain type stands for the same bytes. */
#ifndef SC_BASE_ATOMIC_H
#define SC_BASE_ATOMIC_H

#ifdef __cplusplus
#define SC_ATOMIC(type) type
#else
#include <stdatomic.h>
#define SC_ATOMIC(type) _Atomic type
#endif

#endif
