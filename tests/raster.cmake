# tests of raster
