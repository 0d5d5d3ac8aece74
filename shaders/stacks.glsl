// Runs of stacks: by key and slice, each with its lowest point.
// Needs runs.glsl.

uint block, counts, gap, slice, thickness;

void begin_stacks(uint job) {
    begin_runs(job);
    slice = JOB[job].slice;
    thickness = JOB[job].thickness;
    gap = 1u << slice;
}

uint place_of(uint half_block, uint word) { return pool_load(place, PLACES + STACK_PLACE_WORDS * (half_block >> 1u) + word); }

// The highest run of a column of the block, and its low; and a further run.
uvec4 first_run(uint column) {
    uint lows = pool_load(place, block + STACK_LOWS + column / 2u);
    return uvec4(run_at(block + RUN_WORDS * column), lows >> (column & 1u) * 16u & 0xFFFFu);
}
uvec4 further_run(uint at) { return uvec4(run_at(at), pool_load(place, at + RUN_WORDS) & 0xFFFFu); }

bool is_always_solid(uint class_) { return class_ == 2u || class_ == 6u || class_ >= 9u && class_ <= 11u || class_ == 41u; }
bool always_floats(uint class_) { return class_ >= 3u && class_ <= 5u || class_ == 7u || class_ >= 13u && class_ <= 19u; }

// Height of a run's lowest point, biased as its own is.
uint lowest_of(uvec4 run) {
    if (is_always_solid(class_of(run.xyz))) return run.x;
    return (run.x >> slice << slice) + (run.w << max(slice, LOW_BITS) - LOW_BITS);
}

// Whether two runs are of one key.
bool same_key(uvec4 a, uvec4 b) {
    return class_of(a.xyz) == class_of(b.xyz) && ((a.z ^ b.z) & KEY_FLAGS) == 0u;
}

// Where the list of one of a half block's two derived blocks lies; `number`: of the half block among those that have lists.
uint list_at(uint number, uint side) { return lists_at(IS_WIDE) + (2u * (number - 1u) + side) * list_words(IS_WIDE); }

uint code_of(uint height) { return (height ^ HEIGHT_SIGN) - base; }
