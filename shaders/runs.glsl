// Runs of a section under the mask, as passes read them that derive from them.
// Needs pool.glsl, section.glsl, derive.glsl.

layout(constant_id = ID_ALL) const bool ALL = false; // every run of the sections is shown

uvec2 place, derived;
uint base; // lattice height of code 0
bool values;
uvec4 visible_low, visible_high;
uint hidden_flags;
uint tie; // see Job

// Sets the above for a job.
void begin_runs(uint job) {
    place = JOB[job].section.xy;
    // Read whole: lavapipe gave a wrong third component when it was read by itself.
    uvec4 here = JOB[job].near[4];
    derived = here.xy;
    base = here.z;
    values = DERIVE.values != 0u;
    tie = JOB[job].tie;
    if (ALL) return;
    visible_low = uvec4(DERIVE.visible[0], DERIVE.visible[1], DERIVE.visible[2], DERIVE.visible[3]);
    visible_high = uvec4(DERIVE.visible[4], DERIVE.visible[5], DERIVE.visible[6], DERIVE.visible[7]);
    hidden_flags = DERIVE.hidden_flags;
}

uvec3 run_at(uint at) { return uvec3(pool_load(place, at), pool_load(place, at + 1u), pool_load(place, at + 2u)); }

uint class_of(uvec3 run) { return run.y >> RUN_CLASS_SHIFT; }

bool shown(uvec3 run) {
    uint class_ = class_of(run);
    uvec4 some = class_ < 128u ? visible_low : visible_high;
    uvec2 pair = (class_ & 64u) == 0u ? some.xy : some.zw;
    uint word = (class_ & 32u) == 0u ? pair.x : pair.y;
    return (word >> (class_ & 31u) & 1u) != 0u && (run.z & hidden_flags) == 0u;
}

// As `tells_nothing` in src/attribute/class.rs.
bool tells_nothing(uvec3 run) {
    uint class_ = class_of(run);
    return class_ <= 1u || class_ == 12u;
}

// What a column shows whose top is this run.
uint shows_of(uvec3 run) {
    uint shows = class_of(run) << SHOWN_CLASS_SHIFT;
    return shows | (values ? run.y >> RUN_INTENSITY_SHIFT & 0xFFFFu | (run.z >> RUN_RETURNS_SHIFT & 0xFFu) << SHOWN_RETURNS_SHIFT
                           : run.y & 0xFFu | run.z >> RUN_GREEN_SHIFT << SHOWN_GREEN_SHIFT
                             | (run.z >> RUN_BLUE_SHIFT & 0xFFu) << SHOWN_BLUE_SHIFT);
}
