# wm.sh VARIANT MODE
: in the project
xargs -P2 -I{} sh -c "LAB_WALK=$2 LAB_TRACE=1 LAB_STDLIB=$LAB/v_$1 $LAB/lr7 rescue --world flats --strategy builtin --preset genuine --starts 1 --seed {} --jobs 1 --list > $LAB/wm_$1_$2_{}.out 2>/dev/null" < $LAB/wseeds
echo "$1 $2 homes $(grep -hE '^flats +builtin' $LAB/wm_$1_$2_*.out | awk '{s+=$3} END {print s, NR}')" | tee -a $LAB/results.txt
