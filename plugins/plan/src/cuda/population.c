#define THREADS 256

// Members of a population in the memory of the device. Block `[x, y]` works for the member at place `y`.
typedef struct {
    float *states;            // Parameters and moments, `state_size` entries a member.
    float *values;            // Inputs, then outputs, then other values of the routine, `value_size` entries a member.
    const float *constants;   // Entries that all members share.
    const unsigned *tensors;  // First entry of each tensor of the routine in a member's state.
    const unsigned *members;  // The number of members of the run, then the member at each place.
    const unsigned *runs;     // Words of each place's run: the seed in two, then step and root of each Adam.
    unsigned long long state_size, value_size;
    unsigned run_size;
} Population;
