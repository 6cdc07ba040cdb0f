// The kernel for any processor: two lanes (SSE2 on x86-64, NEON on ARM).
#include "tree.h"
#define LANES 2
#define INSTRUCTIONS baseline
#include "kernel.h"
