/* One device, so that `make cortex-m` reports the memory it takes. */
#include "haptix_device.h"

extern hx_device the_device;
hx_device the_device;
