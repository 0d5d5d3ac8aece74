// to[i] = runs[i] ^ derived[i] of the section that the table names. One thread an element. The table holds two
// addresses: runs, derived.
#version 460
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x_id = 0) in;

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint w[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Table { uvec2 runs, derived; };

layout(push_constant, scalar) uniform Push {
    Table table;
    Words to;
    uint count;
};

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < count) to.w[i] = Words(table.runs).w[i] ^ Words(table.derived).w[i];
}
