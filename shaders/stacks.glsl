// Spans of stacks: points of a key, each with the run that is its highest, and how deep it reaches below that.
// Heights of all that these say are codes.
// Needs runs.glsl.

uint block, counts, gap, depth_step, thickness;

void begin_stacks(uint job) {
    begin_runs(job);
    begin_form(job);
    uint slice = JOB[job].slice;
    thickness = JOB[job].thickness;
    gap = 1u << slice;
    depth_step = max(slice, DEPTH_SLICE_BITS) - DEPTH_SLICE_BITS;
}

uint place_of(uint half_block, uint word) { return pool_load(place, PLACES + STACK_PLACE_WORDS * (half_block >> 1u) + word); }

const uint STACK_RUN = WIDE ? STACK_RUN_WORDS_WIDE : STACK_RUN_WORDS;

// The blocks before the one that starts at a word.
uint blocks_before(uint at) { return (at - FIRST_STACK_BLOCK) / (STACK_RUN * BLOCK_COLUMNS); }

// A span: the code of its highest point (0: there is none), the rest of that run, and how deep it reaches.
uvec4 span_at(uint at) {
    uvec3 run = run_at(at);
    if (WIDE) return uvec4(run, pool_load(place, at + RUN_WORDS));
    return uvec4(run.x & MOST_NARROW_CODE, run.yz, run.x >> 16u);
}

// The highest span of a column of the block.
uvec4 first_span(uint column) { return span_at(block + STACK_RUN * column); }

bool is_always_solid(uint class_) { return class_ == 2u || class_ == 6u || class_ >= 9u && class_ <= 11u || class_ == 41u; }
bool always_floats(uint class_) { return class_ >= 3u && class_ <= 5u || class_ == 7u || class_ >= 13u && class_ <= 19u; }

// Code of a span's lowest point.
uint lowest_of(uvec4 span) { return span.x - min(span.w << depth_step, span.x - 1u); }

// Of a column, whose further spans lie from `at` to `end`: what it shows whose highest solid span is `top`. If that tells nothing, another
// of those that are as high but for the tie does.
uint shows_of_solid(uvec4 top, uint at, uint end) {
    if (ALL || tie == 0u || top.x == 0u || !tells_nothing(top.xyz)) return shows_of(top.xyz);
    uint least = top.x - min(tie, top.x - 1u);
    for (; at < end; at += STACK_RUN) {
        uvec4 next = span_at(at);
        if (next.x < least) break;
        if (shown(next.xyz) && !tells_nothing(next.xyz)) return shows_of(next.xyz);
    }
    return shows_of(top.xyz);
}

// Where the list of one of a half block's two derived blocks lies; `number`: of the half block among those that have lists.
uint list_at(uint number, uint side) { return lists_at(form) + (2u * (number - 1u) + side) * list_words(form); }
