# Build rules that every module uses: warnings, sanitizers, libraries, tests, fuzz targets.

option(SCANCART_WERROR "Treat warnings as errors" OFF)
option(SCANCART_COVERAGE "Instrument for line coverage" OFF)
option(SCANCART_FUZZ "Build libFuzzer targets (needs clang)" OFF)
set(SCANCART_SANITIZE "" CACHE STRING "Sanitizers, e.g. address,undefined or thread")

set(CMAKE_C_STANDARD 11)
set(CMAKE_C_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)
set(CMAKE_CXX_STANDARD 17)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE RelWithDebInfo)
endif()
# Asserts are for our own bugs and stay on in every build.
set(CMAKE_C_FLAGS_RELWITHDEBINFO "-O2 -g")
set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O2 -g")
set(CMAKE_C_FLAGS_RELEASE "-O3")
set(CMAKE_CXX_FLAGS_RELEASE "-O3")

add_library(scancart_flags INTERFACE)
target_compile_definitions(scancart_flags INTERFACE _POSIX_C_SOURCE=200809L
  SCANCART_VERSION="${PROJECT_VERSION}")
target_include_directories(scancart_flags INTERFACE "${CMAKE_SOURCE_DIR}/host" "${CMAKE_SOURCE_DIR}")
# -ffp-contract=off: the same bytes on every machine; a kernel that wants fused operations says why.
target_compile_options(scancart_flags INTERFACE
  -ffp-contract=off -fno-math-errno -fno-trapping-math
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wundef -Wvla -Wcast-qual -Wswitch-enum
  # clang takes every INFINITY and NAN, which are float constants, for a promotion
  $<$<NOT:$<C_COMPILER_ID:Clang>>:-Wdouble-promotion>
  $<$<COMPILE_LANGUAGE:C>:-Wstrict-prototypes> $<$<COMPILE_LANGUAGE:C>:-Wmissing-prototypes>)
if(SCANCART_WERROR)
  target_compile_options(scancart_flags INTERFACE -Werror)
endif()
if(SCANCART_SANITIZE)
  target_compile_options(scancart_flags INTERFACE -fsanitize=${SCANCART_SANITIZE}
    -fno-omit-frame-pointer -fno-sanitize-recover=all)
  target_link_options(scancart_flags INTERFACE -fsanitize=${SCANCART_SANITIZE})
endif()
if(SCANCART_COVERAGE)
  target_compile_options(scancart_flags INTERFACE --coverage)
  target_link_options(scancart_flags INTERFACE --coverage)
endif()
if(SCANCART_SANITIZE OR SCANCART_COVERAGE OR SCANCART_FUZZ)
  target_compile_definitions(scancart_flags INTERFACE SCANCART_NO_CLONES) # see host/base/simd.h
endif()
if(SCANCART_FUZZ)
  target_compile_options(scancart_flags INTERFACE -fsanitize=fuzzer-no-link)
endif()

# scancart_library(NAME SOURCES a.c ... [DEPS lib ...] [PKG pkgconfig-module ...])
# A static library with the project's flags. DEPS are public, PKG modules are private.
function(scancart_library name)
  cmake_parse_arguments(A "" "" "SOURCES;DEPS;PKG" ${ARGN})
  add_library(${name} STATIC ${A_SOURCES})
  target_link_libraries(${name} PUBLIC scancart_flags ${A_DEPS} m)
  foreach(module IN LISTS A_PKG)
    string(MAKE_C_IDENTIFIER "PKG_${module}" key)
    if(NOT TARGET PkgConfig::${key})
      pkg_check_modules(${key} REQUIRED IMPORTED_TARGET GLOBAL ${module})
    endif()
    target_link_libraries(${name} PRIVATE PkgConfig::${key})
  endforeach()
endfunction()

# scancart_test(NAME SOURCES a.c ... [DEPS lib ...] [LABELS unit|prop|golden|e2e ...] [TIMEOUT s])
# A cmocka program run by ctest from the source root; exit status 77 is SKIP.
function(scancart_test name)
  cmake_parse_arguments(A "" "TIMEOUT" "SOURCES;DEPS;LABELS" ${ARGN})
  if(NOT A_TIMEOUT)
    set(A_TIMEOUT 60)
  endif()
  add_executable(${name} ${A_SOURCES})
  target_link_libraries(${name} PRIVATE scancart_flags ${A_DEPS} cmocka m)
  target_compile_definitions(${name} PRIVATE SCANCART_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
  add_test(NAME ${name} COMMAND ${name} WORKING_DIRECTORY "${CMAKE_SOURCE_DIR}")
  set_tests_properties(${name} PROPERTIES TIMEOUT ${A_TIMEOUT} SKIP_RETURN_CODE 77
    LABELS "${A_LABELS}")
endfunction()

# scancart_script_test(NAME COMMAND cmd args... [LABELS ...] [TIMEOUT s])
# Any command as a test, run from the source root with SCANCART_BIN set to the built program.
function(scancart_script_test name)
  cmake_parse_arguments(A "" "TIMEOUT" "COMMAND;LABELS" ${ARGN})
  if(NOT A_TIMEOUT)
    set(A_TIMEOUT 120)
  endif()
  add_test(NAME ${name} COMMAND ${A_COMMAND} WORKING_DIRECTORY "${CMAKE_SOURCE_DIR}")
  set_tests_properties(${name} PROPERTIES TIMEOUT ${A_TIMEOUT} SKIP_RETURN_CODE 77
    LABELS "${A_LABELS}"
    ENVIRONMENT "SCANCART_BIN=${CMAKE_BINARY_DIR}/host/app/scancart;SCANCART_BUILD=${CMAKE_BINARY_DIR}")
endfunction()

# scancart_fuzz(NAME SOURCES a.c ... [DEPS lib ...])
# With clang and SCANCART_FUZZ a libFuzzer program; otherwise a program that replays the kept corpus
# tests/fuzz/corpus/NAME/ once, so that every past finding stays a test.
function(scancart_fuzz name)
  cmake_parse_arguments(A "" "" "SOURCES;DEPS" ${ARGN})
  if(SCANCART_FUZZ)
    add_executable(fuzz_${name} ${A_SOURCES})
    target_link_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
  else()
    add_executable(fuzz_${name} ${A_SOURCES} "${CMAKE_SOURCE_DIR}/tests/support/fuzz_replay.c")
    add_test(NAME fuzz_${name} COMMAND fuzz_${name} "${CMAKE_SOURCE_DIR}/tests/fuzz/corpus/${name}"
      WORKING_DIRECTORY "${CMAKE_SOURCE_DIR}")
    set_tests_properties(fuzz_${name} PROPERTIES TIMEOUT 60 LABELS fuzz)
  endif()
  target_link_libraries(fuzz_${name} PRIVATE scancart_flags ${A_DEPS} m)
endfunction()
