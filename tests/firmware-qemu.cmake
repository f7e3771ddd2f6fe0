# Tests of the controller on emulated boards, and of its serial line. Label qemu: boots an emulator.
pkg_check_modules(MODBUS_TEST REQUIRED IMPORTED_TARGET libmodbus)
find_program(PYTHON_DEBIAN python3 PATHS /usr/bin NO_DEFAULT_PATH REQUIRED)

# Benches: the firmware on its simulated port, on a pseudo-terminal; a master that knows every answer.
add_executable(controller_sim support/controller_sim.c)
target_link_libraries(controller_sim PRIVATE scancart_flags fw_port_sim sc_base)
add_executable(controller_torture e2e/controller_torture.c)
target_link_libraries(controller_torture PRIVATE scancart_flags fw_shared sc_base PkgConfig::MODBUS_TEST)
add_executable(controller_probe e2e/controller_probe.c)
target_link_libraries(controller_probe PRIVATE scancart_flags fw_shared PkgConfig::MODBUS_TEST)
scancart_test(test_same_steps SOURCES unit/firmware/test_same_steps.c DEPS fw_core LABELS "unit;firmware")

scancart_test(test_motor SOURCES unit/test_motor.c DEPS sc_capture LABELS "unit;firmware")

set(e2e "${CMAKE_CURRENT_SOURCE_DIR}/e2e")
# Natively: fast, under sanitizers too.
scancart_script_test(controller_cli COMMAND ${PYTHON_DEBIAN} ${e2e}/controller_cli.py sim
  LABELS "e2e;firmware" TIMEOUT 120)
scancart_script_test(controller_torture_native COMMAND ${PYTHON_DEBIAN} ${e2e}/controller_torture.py sim
  $<TARGET_FILE:controller_torture> 4000 LABELS "e2e;firmware" TIMEOUT 120)

# Images: size, worst stack, nothing of libc but memcpy and its like. Then what needs an emulator.
scancart_script_test(firmware_images COMMAND "${CMAKE_SOURCE_DIR}/scripts/firmware-build" --check
  LABELS "structure;firmware" TIMEOUT 300)
scancart_script_test(firmware_target_tests COMMAND "${CMAKE_SOURCE_DIR}/scripts/firmware-target-tests"
  LABELS "qemu;firmware" TIMEOUT 300)
scancart_script_test(controller_f405 COMMAND ${PYTHON_DEBIAN} ${e2e}/controller_f405.py
  LABELS "qemu;firmware" TIMEOUT 150)
scancart_script_test(controller_cli_qemu COMMAND ${PYTHON_DEBIAN} ${e2e}/controller_cli.py qemu
  LABELS "qemu;firmware" TIMEOUT 180)
scancart_script_test(controller_interop COMMAND ${PYTHON_DEBIAN} ${e2e}/controller_interop.py
  $<TARGET_FILE:controller_probe> LABELS "qemu;firmware" TIMEOUT 240)
scancart_script_test(controller_torture_qemu COMMAND ${PYTHON_DEBIAN} ${e2e}/controller_torture.py qemu
  $<TARGET_FILE:controller_torture> 2000 LABELS "qemu;firmware" TIMEOUT 300)
# One emulator at a time: each wants a processor of its own to keep the time of a serial line.
set_tests_properties(firmware_target_tests controller_f405 controller_cli_qemu controller_interop
  controller_torture_qemu PROPERTIES RESOURCE_LOCK emulator)
scancart_script_test(cart_f405_wiring COMMAND "${CMAKE_SOURCE_DIR}/boards/cart_f405/check-wiring"
  LABELS "structure;firmware")
