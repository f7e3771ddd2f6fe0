# Lists of sources, used by the native build and by the boards' images. Paths are relative to this folder.
# Images link FW_SHARED_SOURCES and FW_CORE_SOURCES with one port; the texts are for the host only.
set(FW_SHARED_SOURCES
  shared/idxevent.c
  shared/mbframe.c
  shared/regmap.c)
set(FW_SHARED_TEXT_SOURCES
  shared/faultcode.c
  shared/regmap_text.c)
set(FW_CORE_SOURCES
  core/axis.c
  core/commission.c
  core/cregs.c
  core/ctlcmd.c
  core/encunwrap.c
  core/estop.c
  core/evring.c
  core/firmware.c
  core/idxfilter.c
  core/mblink.c
  core/mbslave.c
  core/mirrorctl.c
  core/ramp.c
  core/scanprog.c
  core/stepsched.c
  core/strobe.c
  core/timebase.c)
