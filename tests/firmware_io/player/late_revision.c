/* Which samples the player counts as driven, with revisions under way. */
#include <stdio.h>

#include "../../../firmware_io/player/haptix_player.c"

static double taken[16];
static uint32_t taken_count;

void hx_host_take(hx_host_window *window, const double *volts, uint32_t n) {
    (void)window;
    for (uint32_t i = 0; i < n; i++) taken[taken_count++] = volts[i];
}

int hx_host_codes(const double *volts, uint32_t n, double before_v, double most_v, double most_step_v,
                  double full_scale_v, int32_t top_code, int16_t *codes) {
    (void)volts, (void)n, (void)before_v, (void)most_v, (void)most_step_v, (void)full_scale_v;
    (void)top_code, (void)codes;
    return 1;
}

int hx_host_check(hx_host_window *window, const hx_host_limits *limits, const double *volts,
                  uint32_t n, uint32_t *sample, double *found) {
    (void)window, (void)limits, (void)volts, (void)n, (void)sample, (void)found;
    return HX_HOST_KEPT;
}

static hx_player player;

/* Ten samples of 1 V; 4 to 6 revised to 2 V, then 5 to 7 to 3 V. */
static void begin(void) {
    memset(&player, 0, sizeof player);
    taken_count = 0;
    for (int i = 0; i < 10; i++) player.queue[i] = 1.0;
    player.counts.sent = 10;
    for (int number = 0; number < 2; number++) {
        revision *r = under_way(&player, player.under_way_count++);
        r->first = 4 + number, r->count = 3;
        for (int i = 0; i < 3; i++) {
            r->before[i] = player.queue[r->first + i];
            player.queue[r->first + i] = 2.0 + number;
        }
    }
}

int main(void) {
    begin(); /* the driver refuses both, after it has played 6 samples */
    take_played(&player, 6);
    undo(&player);
    take_played(&player, 10);
    for (uint32_t i = 0; i < taken_count; i++) printf("%g ", taken[i]);
    printf("\n");
    begin(); /* it obeys the first one, plays 6, and refuses the second */
    player.first_under_way = 1, player.under_way_count = 1;
    take_played(&player, 6);
    undo(&player);
    take_played(&player, 10);
    for (uint32_t i = 0; i < taken_count; i++) printf("%g ", taken[i]);
    printf("\n");
    begin(); /* it obeys both before it plays */
    player.under_way_count = 0;
    take_played(&player, 10);
    for (uint32_t i = 0; i < taken_count; i++) printf("%g ", taken[i]);
    printf("\n");
    return 0;
}
