// What the derived passes share: one job a section, and the mask under which they run.
// Needs pool.glsl.

struct Job {
    uvec2 near[9]; // places of the 3x3 sections around, row by row from the south-west; [4] is the section itself, 0 is none
};

struct Derive {
    uint visible[8];          // bit per class: shown
    uint visible_withheld[8]; // the same for points with the withheld flag
    uint bridge;              // longest gap to bridge, cells; 0: none
    int steep;                // a gap between ends that differ by more than this a cell is no slope but an edge, lattice steps
};

#ifdef POOL_SSBO
layout(set = 0, binding = 1, scalar) readonly buffer Jobs { Job jobs[]; };
layout(set = 0, binding = 2, scalar) readonly buffer DeriveBlock { Derive derive; };
#define JOB jobs
#define DERIVE derive
#else
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer Jobs { Job jobs[]; };
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer DeriveBlock { Derive derive; };
layout(push_constant, scalar) uniform Push { uvec2 jobs; uvec2 derive; } push;
#define JOB Jobs(push.jobs).jobs
#define DERIVE DeriveBlock(push.derive).derive
#endif
