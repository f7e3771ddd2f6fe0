# tests of the cart's devices: the board file, the backends of capture, recordings, and a virtual machine
scancart_test(test_board_config SOURCES unit/test_board_config.c DEPS sc_capture LABELS unit)

# GPIO: the same tests on the real libgpiod 1.x under umockdev and on a stand-in for 2.x.
pkg_check_modules(UMOCKDEV REQUIRED IMPORTED_TARGET umockdev-1.0)
pkg_check_modules(GPIOD_TEST REQUIRED IMPORTED_TARGET libgpiod)
set(backends "${CMAKE_SOURCE_DIR}/host/capture/backends")
if(GPIOD_TEST_VERSION VERSION_LESS 2)
  scancart_test(test_lines_gpiod_v1 SOURCES unit/test_lines_gpiod.c support/chip_sim_umockdev.c
    DEPS sc_capture PkgConfig::UMOCKDEV LABELS unit)
  target_compile_definitions(test_lines_gpiod_v1 PRIVATE TEST_UMOCK)
endif()
scancart_test(test_lines_gpiod_v2 SOURCES unit/test_lines_gpiod.c support/gpiod2/gpiod_mock.c
  ${backends}/lines_gpiod.c ${backends}/lines_gpiod_v2.c DEPS sc_base LABELS unit)
target_include_directories(test_lines_gpiod_v2 BEFORE PRIVATE support/gpiod2)

# The head: the real libusb on a simulated bus.
scancart_test(test_head_usb SOURCES unit/test_head_usb.c support/head_sim.c
  DEPS sc_capture PkgConfig::UMOCKDEV LABELS unit)

scancart_test(test_camera_backends SOURCES unit/test_camera_backends.c DEPS sc_capture LABELS unit)

# A recording: captured again, it gives the same bytes. (fake_cart is in capture.cmake.)
scancart_test(test_replay SOURCES unit/test_replay.c DEPS fake_cart sc_capture sc_site LABELS unit)

# A Linux machine in QEMU with real kernel devices; see tests/e2e/vm_capture.py.
add_executable(vm_head support/vm_head.c)
target_link_libraries(vm_head PRIVATE sc_base)
add_executable(vm_gpio support/vm_gpio.c)
target_link_libraries(vm_gpio PRIVATE scancart_flags)
add_executable(vm_probe e2e/vm_probe.c)
target_link_libraries(vm_probe PRIVATE sc_capture)
scancart_script_test(vm_capture COMMAND ${PYTHON_DEBIAN} ${CMAKE_CURRENT_SOURCE_DIR}/e2e/vm_capture.py
  LABELS "e2e;qemu" TIMEOUT 330)
set_tests_properties(vm_capture PROPERTIES RESOURCE_LOCK emulator)
add_executable(bench_head_usb bench/bench_head_usb.c support/head_sim.c)
target_link_libraries(bench_head_usb PRIVATE sc_capture PkgConfig::UMOCKDEV)
