# tests of structure: the tree is the architecture
scancart_script_test(structure_dependencies COMMAND scripts/check-deps LABELS structure)
scancart_script_test(structure_headers COMMAND scripts/check-headers LABELS structure TIMEOUT 300)
scancart_script_test(structure_symbols COMMAND scripts/check-symbols "${CMAKE_BINARY_DIR}" LABELS structure)
scancart_script_test(structure_checks COMMAND tests/e2e/structure_checks.sh LABELS structure)
