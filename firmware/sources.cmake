# Lists of sources, used by the native build and by the boards' images. Paths are relative to this folder.
# Images link FW_SHARED_SOURCES and FW_CORE_SOURCES; the texts are for the host only.
set(FW_SHARED_SOURCES
  shared/idxevent.c
  shared/mbframe.c
  shared/regmap.c)
set(FW_SHARED_TEXT_SOURCES
  shared/faultcode.c
  shared/regmap_text.c)
