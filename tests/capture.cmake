# tests of capture
add_library(fake_cart STATIC support/fake_cart.c)
target_link_libraries(fake_cart PUBLIC sc_capture sc_device fw_port_sim)
scancart_test(test_session SOURCES unit/test_session.c DEPS fake_cart sc_capture sc_site LABELS unit)
