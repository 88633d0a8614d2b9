/* A Cortex-M that qemu emulates (mps2-an385). */
#include "../../cortex_m/startup.h"
#define FAR
