# tests of structure
