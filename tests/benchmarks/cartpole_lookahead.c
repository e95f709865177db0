/* The lookahead of serp in the file of cart-pole, as one would write it by hand for this file alone:
   breadth-first, equal states of a layer are one node, then the best path from every node. */
#include <stdint.h>
#include <string.h>

enum { FLUENTS = 4, DEPTH = 5, NODES = 1024, TABLE = 2048, SAFE = 1 << 30 };

static const double forces[] = {-1.0, 1.0, 0.0, -0.5, 0.5};
static const double dt = 0.02, discount = 0.99;

typedef struct { double risk, value; int rank, steps; } Score;

static double states[NODES][FLUENTS], reward[NODES * ACTIONS];
static int child[NODES * ACTIONS], unsafe[NODES * ACTIONS], table[TABLE];
static Score best[NODES];

/* One step; returns whether the pole has fallen. */
static int step(const double *s, int action, double *out, double *gained) {
    double x = s[0], v = s[1] + 0.195 * forces[action];
    double a = s[2], w = s[3] - 0.29 * forces[action];
    double rise = dt * (15.8 * a);
    x += dt * v;
    a += dt * w;
    w += rise;
    double r = 1.0;
    if (a > 0.0) r -= a / 0.2618;
    if (a < 0.0) r += a / 0.2618;
    if (x > 0.0) r -= 0.1 * x;
    if (x < 0.0) r += 0.1 * x;
    int fallen = a > 0.2618 || a < -0.2618 || x > 2.4 || x < -2.4;
    if (fallen) r -= 1.0;
    out[0] = x, out[1] = v, out[2] = a, out[3] = w;
    *gained = r;
    return fallen;
}

/* The slot of a state, or of the free place for it. */
static int slot_of(const double *s) {
    uint64_t hash = 0, word;
    for (int i = 0; i < FLUENTS; i++) {
        double number = s[i] + 0.0;
        memcpy(&word, &number, sizeof word);
        hash = (hash ^ word) * 0x9E3779B97F4A7C15u;
        hash ^= hash >> 29;
    }
    int slot = (int)(hash & (TABLE - 1));
    while (table[slot] >= 0) {
        const double *other = states[table[slot]];
        if (other[0] == s[0] && other[1] == s[1] && other[2] == s[2] && other[3] == s[3]) break;
        slot = (slot + 1) & (TABLE - 1);
    }
    return slot;
}

static int better(Score a, Score b) {
    if (a.rank != b.rank) return a.rank < b.rank;
    if (a.risk != b.risk) return a.risk < b.risk;
    if (a.steps != b.steps) return a.steps > b.steps;
    return a.value > b.value;
}

static long search(const double *root, double *value) {
    int start = 0, end = 1;
    long edges = 0;
    memcpy(states[0], root, sizeof states[0]);
    for (int depth = 0; depth < DEPTH && start < end; depth++) {
        int stored = end, keep = depth + 1 < DEPTH;
        if (keep) memset(table, -1, sizeof table);
        for (int node = start; node < end; node++)
            for (int action = 0; action < ACTIONS; action++, edges++) {
                int e = node * ACTIONS + action;
                double next[FLUENTS];
                unsafe[e] = step(states[node], action, next, &reward[e]);
                child[e] = -1;
                if (unsafe[e] || !keep) continue;
                int slot = slot_of(next);
                if (table[slot] < 0) {
                    table[slot] = stored;
                    memcpy(states[stored++], next, sizeof next);
                }
                child[e] = table[slot];
            }
        start = end, end = stored;
    }
    for (int node = start - 1; node >= 0; node--)
        for (int action = 0; action < ACTIONS; action++) {
            int e = node * ACTIONS + action;
            Score path = {unsafe[e], reward[e], unsafe[e] ? 2 : 0, SAFE};
            if (child[e] >= 0) {
                const Score *after = &best[child[e]];
                path.value += discount * after->value;
                path.risk += (1.0 - path.risk) * after->risk;
                if (after->steps != SAFE) path.steps = after->steps + 1;
            }
            if (unsafe[e]) path.steps = 0;
            if (action == 0 || better(path, best[node])) best[node] = path;
            value[action] = path.value; /* those of the root come last, and remain */
        }
    return edges;
}

/* Values [count][ACTIONS] of the first actions in states [count][FLUENTS]. */
void lookahead(int count, const double *roots, double *values, long *edges) {
    *edges = 0;
    for (int k = 0; k < count; k++)
        *edges += search(roots + k * FLUENTS, values + k * ACTIONS);
}
