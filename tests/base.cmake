# tests of base
scancart_test(test_sheet SOURCES unit/test_sheet.c DEPS sc_base LABELS unit)
scancart_test(prop_camera SOURCES prop/prop_camera.c DEPS sc_base LABELS prop)
scancart_test(prop_pose SOURCES prop/prop_pose.c DEPS sc_base LABELS prop)
scancart_test(test_pose SOURCES unit/test_pose.c DEPS sc_base LABELS unit)
scancart_test(test_camera SOURCES unit/test_camera.c DEPS sc_base LABELS unit)
