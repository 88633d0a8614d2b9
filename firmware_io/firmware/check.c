/* `make check`: the fuzzer's calls with random bytes, for machines without libFuzzer. */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int main(void) {
    static uint8_t data[2048];
    uint32_t state = 1;
    for (int round = 0; round < 3000; round++) {
        for (size_t i = 0; i < sizeof data; i++) {
            state = state * 1664525u + 1013904223u;
            data[i] = (uint8_t)(state >> 24);
        }
        LLVMFuzzerTestOneInput(data, state % sizeof data);
    }
    puts("3000 random programs: no output above the ceiling, nothing left standing.");
    return 0;
}
