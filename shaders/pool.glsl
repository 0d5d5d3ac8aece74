// Access to the pool and to the frame's buffers: by device address; through storage buffers (POOL_SSBO: one page of at
// most 128 MiB, seen by synchronization validation); or, for pool, table and beams where they are read only, as texels
// (POOL_TEXELS: one page, on CPU drivers, whose threads gather eight texels at once but follow eight addresses one by
// one). A payload's place is a uvec2: its address, or in x the word at which it starts.
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_EXT_scalar_block_layout : require
#include "log.glsl"

#ifdef POOL_SSBO

layout(set = 0, binding = 0, scalar) buffer PoolWords { uint pool_words[]; };

uint pool_load(uvec2 place, uint word) { return pool_words[place.x + word]; }
void pool_store(uvec2 place, uint word, uint value) { pool_words[place.x + word] = value; }

#elif defined(POOL_TEXELS)

layout(set = 0, binding = 1, r32ui) readonly uniform uimageBuffer pool_texels;
layout(set = 0, binding = 2, r32ui) readonly uniform uimageBuffer table_texels;
layout(set = 0, binding = 3, r32ui) readonly uniform uimageBuffer beam_texels;

uint pool_load(uvec2 place, uint word) { return imageLoad(pool_texels, int(place.x + word)).r; }

#else

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint w[]; };

uint pool_load(uvec2 place, uint word) { log_load(place, word); return Words(place).w[word]; }
void pool_store(uvec2 place, uint word, uint value) { Words(place).w[word] = value; }

#endif
