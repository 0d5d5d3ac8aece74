// What threads do, written down for benches/trace.rs by the shaders that define LOGGED; in all others this is nothing.
//
// A thread's log has LOG_WORDS words: how many words there were to write, how many steps it took, then LOG_STEP where a
// step begins, and for each load, in the order of the shader, its 128-byte line. Words beyond the log's end are counted
// and left out. The frame's constants are not counted.
// Needs GL_EXT_buffer_reference, GL_EXT_buffer_reference_uvec2, GL_EXT_scalar_block_layout.
#if defined(LOGGED)
#include "passes.glsl"

layout(buffer_reference, scalar, buffer_reference_align = 4) writeonly buffer Log { uint log_words[]; };

uvec2 log_place;
uint log_first, log_count, log_steps;

void log_word(uint word) {
    if (log_count < LOG_WORDS - 2u) Log(log_place).log_words[log_first + 2u + log_count] = word;
    log_count++;
}

// Begins the log of thread `thread` among those at `place`.
void log_begin(uvec2 place, uint thread) {
    log_place = place;
    log_first = thread * LOG_WORDS;
    log_count = 0u;
    log_steps = 0u;
}

void log_step() {
    log_word(LOG_STEP);
    log_steps++;
}

void log_load(uvec2 place, uint word) {
    uint carry, low = uaddCarry(place.x, word * 4u, carry);
    log_word((place.y + carry) << 25u | low >> 7u);
}

void log_end() {
    Log(log_place).log_words[log_first] = log_count;
    Log(log_place).log_words[log_first + 1u] = log_steps;
}

#else

#define log_step()
#define log_load(place, word)

#endif
