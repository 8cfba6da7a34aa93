/* Products of powers: lists of bases and exponents, equal ones once, and the memory for them.

   graph.h stands before this file. */
#define ARENA 4096 /* bytes of a first piece of an arena; a further one has twice as many */
#define MOST_EXPONENT ((int64_t)1 << 40) /* no number but 1 has such a power */

/* A bump of memory. */
typedef struct { Memory *memory; char *piece; int64_t used, size; } Arena;

static void *from(Arena *arena, int64_t size) {
    size = (size + 15) & ~(int64_t)15;
    if (arena->used + size > arena->size) {
        arena->size = 2 * arena->size > size ? 2 * arena->size : size + ARENA;
        arena->piece = room_for(arena->memory, arena->size), arena->used = 0;
    }
    return arena->used += size, arena->piece + arena->used - size;
}

/* Keys in the order in which they come, each once. */
typedef struct { uint64_t *key; int32_t *slot; int64_t slots, many; } Keys;

static Keys no_keys(Arena *arena, int64_t most) {
    Keys x = {.slots = 4};
    while (x.slots < 2 * most) x.slots *= 2;
    x.key = from(arena, most * sizeof *x.key), x.slot = from(arena, x.slots * sizeof *x.slot);
    return memset(x.slot, -1, x.slots * sizeof *x.slot), x;
}

static int64_t place_among(Keys *x, uint64_t key) {
    uint64_t k = mixed(key) & (x->slots - 1);
    while (x->slot[k] >= 0 && x->key[x->slot[k]] != key) k = (k + 1) & (x->slots - 1);
    if (x->slot[k] < 0) x->key[x->many] = key, x->slot[k] = x->many++;
    return x->slot[k];
}

/* Powers by whole numbers of quarters: bases and exponents, ordered by bases; equal lists have one number, none at all 0. */
typedef struct { int32_t base; int64_t e; } Power;
typedef struct {
    Memory *memory;
    Power *power;
    int64_t *begin;
    int32_t *slot;
    int64_t count, room, power_room;
} Lists;

static int64_t length_of(const Lists *x, int32_t list) { return x->begin[list + 1] - x->begin[list]; }
static const Power *powers_of(const Lists *x, int32_t list) { return x->power + x->begin[list]; }

static uint64_t mixture_of(const Power *power, int64_t many) {
    uint64_t key = many;
    for (int64_t i = 0; i < many; i++) key = mixed(key + mixed(power[i].base + ((uint64_t)power[i].e << 32)));
    return key;
}

static void make_room_for_lists(Lists *x, int64_t room) {
    const uint64_t last = 2 * room - 1;
    x->room = room;
    x->begin = resized(x->memory, x->begin, (room + 1) * sizeof *x->begin);
    x->slot = resized(x->memory, x->slot, 2 * room * sizeof *x->slot);
    memset(x->slot, -1, 2 * room * sizeof *x->slot);
    for (int64_t i = 0; i < x->count; i++) {
        uint64_t k = mixture_of(powers_of(x, i), length_of(x, i)) & last;
        while (x->slot[k] >= 0) k = (k + 1) & last;
        x->slot[k] = i;
    }
}

/* The number of a list that lies elsewhere. */
static int32_t list_of(Lists *x, const Power *power, int64_t many) {
    if (!many) return 0;
    const uint64_t key = mixture_of(power, many);
    uint64_t last = 2 * x->room - 1, k = key & last;
    for (; x->slot[k] >= 0; k = (k + 1) & last) {
        const int32_t i = x->slot[k];
        if (length_of(x, i) != many) continue;
        const Power *const y = powers_of(x, i);
        int64_t same = 0;
        while (same < many && y[same].base == power[same].base && y[same].e == power[same].e) same++;
        if (same == many) return i;
    }
    if (x->count == x->room) {
        make_room_for_lists(x, 2 * x->room), last = 2 * x->room - 1;
        for (k = key & last; x->slot[k] >= 0;) k = (k + 1) & last;
    }
    const int64_t begin = x->begin[x->count];
    if (begin + many > x->power_room) {
        x->power_room = 2 * (begin + many);
        x->power = resized(x->memory, x->power, x->power_room * sizeof *x->power);
    }
    memcpy(x->power + begin, power, many * sizeof *power);
    x->begin[x->count + 1] = begin + many;
    return x->slot[k] = x->count++;
}

static Lists no_lists(Memory *m) {
    Lists x = {.memory = m};
    make_room_for_lists(&x, FEW_NODES);
    return x.begin[0] = x.begin[1] = 0, x.count = 1, x;
}

/* Is sqrt(x^e) = x^(e/2) wherever x^e >= 0, and a power of quarters? */
static int has_root(int64_t quarters) { return quarters % 2 == 0 && quarters % 8 != 0; }
