/* The first 252 bytes of the flash: copies the program to RAM, and starts it there. */
    .syntax unified
    .thumb
    .section .boot, "ax"
    .global boot
#ifdef __ARM_ARCH_8M_MAIN__
/* The RP2350's boot ROM sets up the flash, looks for the five words of an image definition (datasheet, 5.9:
 * a program for its secure ARM cores), and starts it by the vectors before them. */
boot:
    .word stack_top
    .word copy
    .word 0xffffded3, 0x10210142, 0x000001ff, 0, 0xab123579
    .thumb_func
copy:
    movs r0, #0
    msr msplim, r0
#else
/* The RP2040's boot ROM copies these bytes and starts them (datasheet, 2.8.1), if the check sum behind them,
 * which firmware_io/pico_image.py writes, is right: they read the flash by its oldest command, which every
 * flash has. */
    .thumb_func
boot:
    ldr r3, =0x18000000     /* the flash's controller, 4.10.13 */
    movs r0, #0
    str r0, [r3, #0x08]     /* off */
    movs r0, #4
    str r0, [r3, #0x14]     /* a quarter of the system's clock */
    ldr r0, =0x001f0300     /* 32 bits at a time, behind a command */
    str r0, [r3, #0x00]
    movs r0, #0
    str r0, [r3, #0x04]
    ldr r1, =0x180000f4
    ldr r0, =0x03000218     /* 03h and 24 bits of address, on one line */
    str r0, [r1]
    movs r0, #1
    str r0, [r3, #0x08]
#endif
    ldr r0, =image_in_flash
    ldr r1, =image_begin
    ldr r2, =image_end
1:  ldr r3, [r0]
    str r3, [r1]
    adds r0, #4
    adds r1, #4
    cmp r1, r2
    blo 1b
    ldr r0, =0xe000ed08     /* the vectors are the program's first words */
    ldr r1, =image_begin
    str r1, [r0]
    ldr r0, [r1, #0]
    ldr r1, [r1, #4]
    msr msp, r0
    bx r1
    .ltorg
