/* A haptix surface in plain C, on little-endian machines: what a driver needs to use one.
 *     cc -std=c99 -O2 read_surface.c -lm && echo mu 0.5 100 250 2e-7 | ./a.out my.surface
 * Queries: "mu F_N V0 f h0" or "voltage mu F_N f h0" in N, V, Hz, m; nan leaves an axis out. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { OK, PULL_IN, BELOW, ABOVE, OUT_OF_RANGE, BREAKDOWN, FRICTION, PRESSURE, INVALID = -1 };
enum { DRIVE, COLUMNS, F_N, MOST = F_N + 8 }; /* tensors; the normal force F_N is the first axis */
static const double LAST = 0.81; /* (V0 / pull-in voltage)^2 at which a surface ends */
typedef struct { /* columns: -1/mu at each drive, ln(pull-in, limit / unit_v) */
    const void *data[MOST]; size_t count[MOST];
    int tensors, is_single, limited_by; /* the status past ln(breakdown), or OK */
    double unit_v, limit_v, slack, numbers; /* slack: relative, for rounding; numbers in columns */
} Surface;
typedef struct { size_t cell[MOST]; double part[MOST], pull_in, breakdown, top; int status; } Place;
static void need(int good, const char *otherwise) {
    if (!good) fprintf(stderr, "read_surface: %s\n", otherwise), exit(1);
}

/* The value of a key in a JSON object, or "". */
static const char *member(const char *p, const char *key) {
    for (size_t n = strlen(key); *p == '{' || *p == ',';) {
        p += 1 + strspn(p + 1, " \n");
        if (*p == '"' && !strncmp(p + 1, key, n) && p[n + 1] == '"')
            return p + n + 2 + strspn(p + n + 2, " \n:");
        for (int depth = 0; *p && (depth || !strchr(",]}", *p));) { /* to the end of its value */
            depth += (*p == '[' || *p == '{') - (*p == ']' || *p == '}');
            if (*p++ == '"') while (*p && *p++ != '"') p += p[-1] == '\\' && *p;
        }
    }
    return "";
}

static unsigned long crc32(const unsigned char *p, size_t size) {
    unsigned long crc = 0xffffffff;
    for (size_t bit = 0; bit < 8 * size; bit++)
        crc = crc >> 1 ^ ((crc ^ p[bit / 8] >> bit % 8) & 1 ? 0xedb88320 : 0);
    return crc ^ 0xffffffff;
}

static Surface load(const char *path) {
    FILE *file = fopen(path, "rb");
    long size = file && !fseek(file, 0, SEEK_END) ? ftell(file) : 0;
    unsigned char *data = size < 8 ? NULL : malloc((size_t)size);
    need(data && !fseek(file, 0, SEEK_SET) && fread(data, (size_t)size, 1, file), "cannot be read");
    size_t length = 0, room = (size_t)size - 8;
    for (int i = 8; i--;) length = length << 8 | data[i];
    char *header = length > room ? NULL : calloc(2, length + 1);
    need(header != NULL, "no friction surface, or truncated");
    memcpy(header, data + 8, length), data += 8 + length;
    char *own = header + length + 1, *to = own; /* the description: JSON in a JSON string */
    const char *from = member(member(header, "__metadata__"), "haptix");
    while (*from && *++from && *from != '"') *to++ = *(from += *from == '\\');
    need(!strncmp(member(own, "format"), "\"haptix-friction-surface\"", 25), "no friction surface");
    need(!strncmp(member(own, "version"), "\"2.", 3), "expected version 2: build the file again");
    Surface s = {.numbers = 1, .unit_v = strtod(member(own, "unit_v"), NULL),
                 .limit_v = strtod(member(own, "voltage_limit_v"), NULL),
                 .limited_by = !strncmp(member(own, "limited_by"), "\"O", 2) ? OK
                     : !strncmp(member(own, "limited_by"), "\"F", 2) ? FRICTION
                     : !strncmp(member(own, "limited_by"), "\"P", 2) ? PRESSURE : BREAKDOWN,
                 .is_single = !strncmp(member(member(header, "drive"), "dtype"), "\"F32\"", 5)};
    s.slack = s.is_single ? 0x1p-20 : 1e-9;
    const char *crcs = member(own, "crc32"), *name = "drive"; /* which also ends the list of axes */
    for (int i = 0; i < F_N || (i < MOST && name && strcmp(name, "drive")); s.tensors = ++i) {
        const char *spec = member(header, name), *crc = member(crcs, name);
        size_t width = s.is_single ? 4 : 8, begin = 0, end = 0;
        sscanf(member(spec, "data_offsets"), "[%zu ,%zu", &begin, &end);
        need(!strncmp(member(spec, "dtype"), s.is_single ? "\"F32\"" : "\"F64\"", 5) &&
             begin < end && end <= room - length && (length | begin | end) % width == 0 &&
             crc32(data + begin, end - begin) == strtoul(crc, NULL, 10), "the file is damaged");
        s.data[i] = data + begin, s.count[i] = (end - begin) / width;
        if (i != COLUMNS) s.numbers *= s.count[i] + 2.0 * (i == DRIVE);
        name = !i ? "columns" : strtok(i == COLUMNS ? (char *)member(own, "axes") : NULL, "[\", ");
    }
    need(s.unit_v > 0 && s.limit_v > 0 && s.count[DRIVE] > 1 && s.tensors > F_N &&
         s.count[COLUMNS] == s.numbers, "the file is damaged");
    return fclose(file), free(header), s;
}

static double at(const Surface *s, int t, size_t i) {
    return s->is_single ? ((const float *)s->data[t])[i] : ((const double *)s->data[t])[i];
}

/* Entry i of the column at a place: a blend along one axis of blends along the next. */
static double entry(const Surface *s, const Place *p, size_t i, int axis, size_t row) {
    if (axis == s->tensors) return at(s, COLUMNS, row * (s->count[DRIVE] + 2) + i);
    row = row * s->count[axis] + p->cell[axis];
    double low = entry(s, p, i, axis + 1, row), part = p->part[axis];
    return part > 0 ? low + part * (entry(s, p, i, axis + 1, row + 1) - low) : low;
}

static Place find(const Surface *s, const double *x) {
    Place p = {.status = OK, .breakdown = INFINITY};
    for (int i = F_N; i < s->tensors; i++) {
        double low = at(s, i, 0), high = at(s, i, s->count[i] - 1), v = fmin(fmax(x[i], low), high);
        if (isnan(x[i]) && s->count[i] == 1) continue;
        if (!(x[i] > 0 && x[i] < INFINITY && low > 0)) return (Place){.status = INVALID};
        if (x[i] < low * (1 - 1e-6) || x[i] > high * (1 + 1e-6)) p.status = OUT_OF_RANGE;
        while (p.cell[i] + 2 < s->count[i] && at(s, i, p.cell[i] + 1) <= v) p.cell[i]++;
        low = at(s, i, p.cell[i]);
        if (low < high) p.part[i] = log(v / low) / log(at(s, i, p.cell[i] + 1) / low);
    }
    size_t n = s->count[DRIVE];
    p.pull_in = s->unit_v * exp(entry(s, &p, n, F_N, 0));
    if (s->limited_by) p.breakdown = s->unit_v * exp(entry(s, &p, n + 1, F_N, 0));
    return p.top = fmin(pow(fmin(p.breakdown, s->limit_v) / p.pull_in, 2), at(s, DRIVE, n - 1)), p;
}

static double mu(const Surface *s, const Place *p, double voltage, int *status) {
    size_t i = 0;
    double drive = pow(voltage / p->pull_in, 2), end = fmin(drive, p->top), more = 1 + s->slack;
    while (i + 2 < s->count[DRIVE] && at(s, DRIVE, i + 1) <= end) i++;
    double part = (end - at(s, DRIVE, i)) / (at(s, DRIVE, i + 1) - at(s, DRIVE, i));
    double low = entry(s, p, i, F_N, 0), high = entry(s, p, i + 1, F_N, 0);
    *status = p->status || voltage > s->limit_v * more ? OUT_OF_RANGE
            : drive > LAST * more ? PULL_IN : voltage > p->breakdown * more ? s->limited_by : OK;
    return -1 / (low + part * (high - low));
}

static double voltage(const Surface *s, const Place *p, double mu, int *status) {
    size_t i = 0;
    double target = -1 / fmax(mu, 1e-19), rounding = -s->slack * target;
    while (i + 2 < s->count[DRIVE] && entry(s, p, i + 1, F_N, 0) <= target) i++;
    double from = at(s, DRIVE, i), width = at(s, DRIVE, i + 1) - from, low = entry(s, p, i, F_N, 0);
    double rise = fmax(entry(s, p, i + 1, F_N, 0) - low, 1e-300), end = p->pull_in * sqrt(p->top);
    double drive = from + (target - low) * (width / rise);
    int past = (drive - p->top) * rise > rounding * width;
    int broken = p->breakdown < s->limit_v && p->breakdown <= end * (1 + 1e-6);
    *status = p->status ? p->status : target < entry(s, p, 0, F_N, 0) - rounding ? BELOW
            : !past ? OK : broken ? s->limited_by : p->top >= LAST * (1 - 1e-6) ? PULL_IN : ABOVE;
    return fmin(drive < p->top ? p->pull_in * sqrt(fmax(drive, 0)) : end, s->limit_v);
}

int main(int argc, char **argv) {
    Surface s = load(argc == 2 ? argv[1] : "");
    for (char line[1024]; fgets(line, sizeof line, stdin);) {
        double x, place[MOST], *f_n = &place[F_N];
        int n, i = F_N + 1, end = 0, inverse = sscanf(line, "voltage %lf%lf%n", &x, f_n, &end) == 2;
        int forward = sscanf(line, "mu %lf%lf%n", f_n, &x, &end) == 2;
        for (; i < s.tensors && sscanf(line + end, "%lf%n", &place[i], &n) == 1; i++) end += n;
        need(inverse + forward && i == s.tensors, "expected mu F_N V0 f h0 or voltage mu F_N f h0");
        Place p = find(&s, place);
        int status = INVALID, valid = p.status != INVALID && isfinite(x) && (inverse || x >= 0);
        double value = valid ? (inverse ? voltage : mu)(&s, &p, x, &status) : NAN;
        printf("%.17g %d\n", value, status);
    }
}
