// Picks each column's top under the mask: its highest run of a visible class.
// Reads counts, block offsets and attributes; writes the tops plane.
// One workgroup an 8x8 block, one thread a column; y is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"

layout(local_size_x = 64) in;

void main() {
    uvec2 place = JOB[gl_WorkGroupID.y].near[4];
    uint block = gl_WorkGroupID.x, column = gl_LocalInvocationID.x;

    // The column's first run: the block's, plus the counts of the columns before it (four to a word).
    uint counts = pool_load(place, HEADER_COUNTS) + block * 16u;
    uint run = pool_load(place, pool_load(place, HEADER_BLOCKS) + block);
    for (uint w = 0u; w < column / 4u; w++) {
        uint four = pool_load(place, counts + w);
        uint pairs = (four & 0x00FF00FFu) + (four >> 8u & 0x00FF00FFu);
        run += (pairs & 0xFFFFu) + (pairs >> 16u);
    }
    uint four = pool_load(place, counts + column / 4u);
    for (uint c = 0u; c < column % 4u; c++) run += four >> (8u * c) & 0xFFu;
    uint count = four >> (8u * (column % 4u)) & 0xFFu;

    uint attributes = pool_load(place, HEADER_ATTRIBUTES);
    uint top = NO_RUN;
    for (uint r = run; r < run + count; r++) {
        uint class_ = pool_load(place, attributes + 2u * r) >> 24u;
        bool withheld = (pool_load(place, attributes + 2u * r + 1u) & FLAG_WITHHELD) != 0u;
        uint shown = withheld ? DERIVE.visible_withheld[class_ >> 5u] : DERIVE.visible[class_ >> 5u];
        if ((shown >> (class_ & 31u) & 1u) != 0u) {
            top = r;
            break;
        }
    }
    pool_store(place, pool_load(place, HEADER_TOPS) + block * 64u + column, top);
}
