# A walk of pseudo-random numbers that saves itself and notes outside of its trial what it computes.
# usage: walk.sh NAME RATE SEED STEPS SAVE_EVERY SAYS AT_SIGTERM CHECKPOINT [--resume]
name=$1 rate=$2 seed=$3 steps=$4 every=$5 says=$6 at_sigterm=$7 checkpoint=$8
note() { echo "$1 $step" >> "$KILLS_NOTES/$name-$seed"; }
save() {
  note saving
  echo "$step $x" > "$checkpoint/new" && mv "$checkpoint/new" "$checkpoint/state"
  note saved
}
say() {
  value=$((step * rate + x % 1000))
  case $says in
    stdout) echo "step=$step value=$value" ;;
    csv) echo "$step,$value" >> curve.csv ;;
  esac
}

leaving=
case $at_sigterm in
  saves) trap 'leaving=1' TERM ;;
  ignores) trap '' TERM ;;
esac
step=0 x=$seed
if [ "$9" = --resume ]; then read -r step x < "$checkpoint/state"; fi
[ "$says" != csv ] || [ -f curve.csv ] || echo step,value > curve.csv
note begins
while [ "$step" -lt "$steps" ]; do
  sleep 0.25
  x=$(((x * 1103515245 + 12345) % 2147483648)) step=$((step + 1))
  note computes
  say
  if [ $((step % every)) = 0 ] || [ "$leaving" ]; then save; fi
  if [ "$leaving" ]; then exit 0; fi
done
note ends
