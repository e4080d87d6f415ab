// Reads from standard input, in words of 4 bytes: the number of members, the entries of a member's state and the number
// of runs; the first entry of each tensor, the constants, all states; the member of each run, its words, its inputs.
// Writes all states, and the outputs of each run.

template <class T>
static T *words(size_t n) {
    T *const all = (T *)malloc(4 * n + 4);
    if (!all || fread(all, 4, n, stdin) != n) exit(1);
    return all;
}

// Numbers on which no result may depend.
static float *arbitrary(size_t n) {
    float *const all = (float *)malloc(4 * n + 4);
    if (!all) exit(1);
    for (size_t i = 0; i < n; i++) all[i] = -7.5e33f;
    return all;
}

int main() {
    const unsigned *const sizes = words<unsigned>(3);
    Population p = {};
    p.state_size = sizes[1];
    p.input_size = INPUT_SIZE;
    p.output_size = OUTPUT_SIZE;
    p.value_size = VALUE_SIZE;
    p.run_size = RUN_SIZE;
    p.tensors = words<unsigned>(N_TENSORS);
    p.constants = words<float>(N_CONSTANTS);
    const size_t n_states = sizes[0] * p.state_size, n_runs = sizes[2];
    p.states = words<float>(n_states);
    unsigned *const members = words<unsigned>(n_runs + 1);
    p.members = members;
    p.runs = words<unsigned>(n_runs * RUN_SIZE);
    p.inputs = words<float>(n_runs * INPUT_SIZE);
    p.outputs = arbitrary(n_runs * OUTPUT_SIZE);
    p.values = arbitrary(n_runs * VALUE_SIZE);
    run_all(p);
    return fwrite(p.states, 4, n_states, stdout) != n_states ||
           fwrite(p.outputs, 4, n_runs * OUTPUT_SIZE, stdout) != n_runs * OUTPUT_SIZE;
}
