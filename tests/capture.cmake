# tests of capture
add_library(fake_cart STATIC support/fake_cart.c)
target_link_libraries(fake_cart PUBLIC sc_capture sc_device fw_port_sim)
scancart_test(test_session SOURCES unit/test_session.c DEPS fake_cart sc_capture sc_site LABELS unit)
add_library(fast_cart STATIC support/fast_cart.c)
target_link_libraries(fast_cart PUBLIC sc_device sc_base)
scancart_test(test_session_threads SOURCES unit/test_session_threads.c
  DEPS fast_cart sc_capture sc_site pthread LABELS threads TIMEOUT 120)
