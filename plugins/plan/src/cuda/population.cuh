#define THREADS 256

// A population in the memory of the device. Block `[x, y]` works for the run at place `y`.
struct Population {
    float *states;            // Parameters and moments, `state_size` entries a member.
    const float *inputs;      // Inputs of the routine, `input_size` entries a place.
    float *outputs;           // Outputs of the routine, `output_size` entries a place.
    float *values;            // Other values of the routine, `value_size` entries a place.
    const float *constants;   // Entries that all members share.
    const unsigned *tensors;  // First entry of each tensor of the routine in a member's state.
    const unsigned *members;  // The number of places of the run, then the member at each place.
    const unsigned *runs;     // Words of the run at each place: the seed in two, then step and root of each Adam.
    unsigned long long state_size, input_size, output_size, value_size;
    unsigned run_size;
};

// The member at the place of a block, and its memory.
#define MEMBER                                                         \
    if (PLACE >= (int)p.members[0]) return;                            \
    float *const state = p.states + p.members[1 + PLACE] * p.state_size; \
    const float *const inputs = p.inputs + PLACE * p.input_size;       \
    float *const outputs = p.outputs + PLACE * p.output_size;          \
    float *const values = p.values + PLACE * p.value_size;             \
    const unsigned *const run = p.runs + PLACE * (unsigned long long)p.run_size;
