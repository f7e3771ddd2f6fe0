# tests of twin, and of the rig model and the head's protocol that it shares with capture and fusion
scancart_test(test_rig SOURCES unit/test_rig.c DEPS sc_base LABELS unit)
scancart_test(test_head_packet SOURCES unit/test_head_packet.c DEPS sc_base LABELS unit)
scancart_fuzz(head_packet SOURCES fuzz/fuzz_head_packet.c DEPS sc_base)
scancart_test(test_cart SOURCES unit/test_cart.c DEPS sc_twin LABELS unit)
add_executable(bench_twin bench/bench_twin.c)
target_link_libraries(bench_twin PRIVATE sc_twin OpenMP::OpenMP_C)
