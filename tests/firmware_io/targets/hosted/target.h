/* A processor with an operating system and a C library: qemu-user, WASI. */
#include <stdio.h>
#include <stdlib.h>

#define FAR

void board_main(void);

static void leave(const char *words, uint32_t is_well) {
    fputs(words, stdout);
    exit(is_well ? 0 : 1);
}

int main(void) {
    board_main();
    return 2;
}
