// Reads from standard input, in words of 4 bytes: the number of members in memory, the entries of a member's state, the
// first entry of each tensor, the constants; all states and all values; the number of members of the run, their places in
// memory, the words of their runs. Writes all states and all values after the run.

static void *words(size_t n) {
    void *const all = malloc(4 * n + 4);
    if (!all || fread(all, 4, n, stdin) != n) exit(1);
    return all;
}

int main(void) {
    const unsigned *const sizes = words(2);
    Population p = {0};
    p.state_size = sizes[1];
    p.value_size = VALUE_SIZE;
    p.run_size = RUN_SIZE;
    p.tensors = words(N_TENSORS);
    p.constants = words(N_CONSTANTS);
    const size_t n_states = sizes[0] * p.state_size, n_values = sizes[0] * p.value_size;
    p.states = words(n_states);
    p.values = words(n_values);
    const unsigned *const n = words(1);
    unsigned *const members = malloc(4 * (n[0] + 1));
    if (!members) return 1;
    members[0] = n[0];
    if (fread(members + 1, 4, n[0], stdin) != n[0]) return 1;
    p.members = members;
    p.runs = words((size_t)n[0] * RUN_SIZE);
    run_all(p);
    return fwrite(p.states, 4, n_states, stdout) != n_states || fwrite(p.values, 4, n_values, stdout) != n_values;
}
