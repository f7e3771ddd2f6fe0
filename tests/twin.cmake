# tests of twin
