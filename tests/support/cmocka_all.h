/* cmocka with the headers it needs first. */
#ifndef SC_TESTS_CMOCKA_ALL_H
#define SC_TESTS_CMOCKA_ALL_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#endif
