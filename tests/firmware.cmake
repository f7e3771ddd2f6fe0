# tests of the firmware's shared part, core and simulated port
scancart_test(test_estop SOURCES unit/firmware/test_estop.c DEPS fw_core LABELS "unit;firmware")
scancart_test(test_mbslave SOURCES unit/firmware/test_mbslave.c DEPS fw_core LABELS "unit;firmware")
scancart_test(prop_ramp SOURCES prop/firmware/prop_ramp.c DEPS fw_core sc_base LABELS "prop;firmware" TIMEOUT 300)
scancart_test(prop_cruise SOURCES prop/firmware/prop_cruise.c DEPS fw_core LABELS "prop;firmware;slow" TIMEOUT 300)
scancart_test(prop_motion SOURCES prop/firmware/prop_motion.c DEPS fw_port_sim sc_base LABELS "prop;firmware" TIMEOUT 300)
scancart_test(safety_table SOURCES prop/firmware/safety_table.c DEPS fw_port_sim LABELS "prop;firmware" TIMEOUT 300)
