// Loops over a picture's pixels are compiled twice, and run with the wider instructions where the processor
// has them. Neither version fuses a multiplication with an addition, so both give the same bytes.
#pragma once

#if defined(NDEBUG) && defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define LAMPGLOW_VECTORIZED [[gnu::target_clones("avx2", "default")]]
#else
#define LAMPGLOW_VECTORIZED
#endif
