# Epsilon-greedy choice with sample averages on bandits with ten arms, as in section 2.3 of Sutton and Barto,
# Reinforcement Learning: An Introduction, 2nd edition, 2018.
#
#   awk -v epsilon=0.1 -v seed=1 -v steps=1000 -v bandits=200 -v every=50 -f bandit.awk
#
# It prints, for every `every` steps, the mean reward of a step and the share of steps that took the best arm.

# The generator of Park and Miller, so that the numbers are those of the seed and not of the awk.
function uniform() { state = (state * 16807) % 2147483647; return state / 2147483647 }
function normal() { return sqrt(-2 * log(uniform())) * cos(6.283185307179586 * uniform()) }

function choose(b,   arm, greedy) {
  if (uniform() < epsilon) return int(uniform() * 10)
  greedy = int(uniform() * 10)   # of equal estimates one at random
  for (arm = 0; arm < 10; arm++) if (estimate[b, arm] > estimate[b, greedy]) greedy = arm
  return greedy
}

BEGIN {
  state = (seed + 1) * 69621 % 2147483647
  for (b = 0; b < bandits; b++) {
    best[b] = 0
    for (arm = 0; arm < 10; arm++) {
      value[b, arm] = normal()
      estimate[b, arm] = 0
      if (value[b, arm] > value[b, best[b]]) best[b] = arm
    }
  }
  for (step = 1; step <= steps; step++) {
    for (b = 0; b < bandits; b++) {
      arm = choose(b)
      reward = value[b, arm] + normal()
      estimate[b, arm] += (reward - estimate[b, arm]) / ++taken[b, arm]
      sum += reward
      optimal += arm == best[b]
    }
    if (step % every == 0) {
      n = every * bandits
      printf "{\"step\": %d, \"reward\": %.6f, \"optimal\": %.6f}\n", step, sum / n, optimal / n
      fflush()
      sum = optimal = 0
    }
  }
}
