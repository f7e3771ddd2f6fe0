# Part of vm_inside.sh: a short whole capture with the real devices, and what the site says of it. The
# controller's memory is new: its commissioning values must be stored before it lets the laser on. Homing
# ends near -177 degrees, so the sweep lies there.
scancart=$build/host/app/scancart
check "commissioning" "$probe" save board
limit=150 # two homings and a sweep
check "a whole capture" "$scancart" capture $work/site --board board --station vm --from -172 --to -170 \
    --resolution 0.5 --photo-step 360
limit=60
check "the site is whole" "$scancart" check $work/site
