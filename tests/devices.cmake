# tests of the cart's devices: the board file, the backends of capture, recordings, and a virtual machine
scancart_test(test_board_config SOURCES unit/test_board_config.c DEPS sc_capture LABELS unit)
