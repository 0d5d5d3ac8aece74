// What the test shaders read and write: by device address, or through storage buffers (POOL_SSBO), which
// synchronization validation sees.
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_EXT_scalar_block_layout : require

#ifdef POOL_SSBO

layout(set = 0, binding = 0, scalar) readonly buffer From { uint from_words[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer To { uint to_words[]; };

uint load(uvec2 place, uint word) { return from_words[word]; }
void store(uvec2 place, uint word, uint value) { to_words[word] = value; }

#else

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint w[]; };

uint load(uvec2 place, uint word) { return Words(place).w[word]; }
void store(uvec2 place, uint word, uint value) { Words(place).w[word] = value; }

#endif
