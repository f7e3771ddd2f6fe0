# tests of fusion
