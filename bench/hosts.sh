#!/usr/bin/env bash
# Hosts in three network namespaces of this machine, and `bench latency --hosts` with them. It needs root.
#   bench/hosts.sh target/release/vamaro-swarm --agents 2,4,12 --seconds 2
set -euo pipefail
program=$(realpath "$1")
shift
folder=$(mktemp -d)
run=$$

clean() {
  trap - EXIT
  kill $(jobs -p) 2> /dev/null || true
  wait
  for number in 0 1 2; do ip netns del "vsb-$run-$number" 2> /dev/null || true; done
  rm -r "$folder"
}
trap clean EXIT

(umask 077 && echo "swarm:$(od -An -N32 -tx1 /dev/urandom | tr -d ' \n')" > "$folder/key")
echo 'key = "key"' > "$folder/hosts.toml"
for number in 0 1 2; do
  space=vsb-$run-$number network=10.$((run % 250 + 1)).$number
  ip netns add "$space"
  ip link add "vsb$((run % 100000))-$number" type veth peer name eth0 netns "$space"
  ip addr add "$network.1/30" dev "vsb$((run % 100000))-$number"
  ip link set "vsb$((run % 100000))-$number" up
  ip -n "$space" addr add "$network.2/30" dev eth0
  ip -n "$space" link set eth0 up
  ip -n "$space" link set lo up
  # Whoever is woken runs at once, also on a busy machine.
  mkdir "$folder/$number"
  XDG_RUNTIME_DIR=$folder/$number chrt -f 10 ip netns exec "$space" \
    "$program" host --listen "tcp/$network.2:7447" --key "$folder/key" 2> "$folder/$number/log" &
  until grep -q listening "$folder/$number/log" 2> /dev/null; do sleep 0.05; done
  printf '[[host]]\nname = "host-%s"\nat = "tcp/%s.2:7447"\n' "$number" "$network" >> "$folder/hosts.toml"
done
chrt -f 10 "$program" bench latency --hosts "$folder/hosts.toml" "$@"
