"""Makes table.txt: the results that the WGSL specification, "Floating Point Accuracy", allows for inputs of
built-in functions, computed with 200 bits. A test compares the engine with this table. They share no code.

    python3 table.py > table.txt        # needs mpmath
"""

import random
import struct

from mpmath import mp, mpf

mp.prec = 200
CASES = 100


def bits(x):
    return struct.unpack("<I", struct.pack("<f", float(x)))[0]


def single(word):
    return struct.unpack("<f", struct.pack("<I", word & 0xFFFFFFFF))[0]


LARGEST = mpf(single(0x7F7FFFFF))
LEAST = mpf(2) ** -126


def step(x, up):
    """The next f32 above x, or below x."""
    word = bits(x)
    if x == 0:
        return single(1) if up else -single(1)
    away = (x > 0) == up
    return single(word + 1 if away else word - 1)


def below(x):
    """The largest f32 that isn't above the exact number x."""
    near = float(struct.unpack("<f", struct.pack("<f", float(x)))[0])
    while mpf(near) > x:
        near = step(near, False)
    while mpf(step(near, True)) <= x:
        near = step(near, True)
    return near


def above(x):
    return -below(-x)


class Unbounded(Exception):
    pass


def outwards(lo, hi):
    """Rounds exact ends outwards to f32. Adds 0 if a subnormal may be flushed."""
    if lo < -LARGEST or hi > LARGEST:
        raise Unbounded
    lo, hi = below(lo), above(hi)
    if 0 < lo < LEAST:
        lo = 0.0
    if -LEAST < hi < 0:
        hi = 0.0
    return lo, hi


def ulp(x):
    """The smallest distance between two neighbouring f32 near the exact number x."""
    x = abs(mpf(x))
    if x < LEAST:
        return mpf(2) ** -149
    exponent = int(mp.floor(mp.log(x, 2)))
    while mpf(2) ** exponent > x:
        exponent -= 1
    while mpf(2) ** (exponent + 1) <= x:
        exponent += 1
    # The neighbour below a power of two is nearer than the neighbour above.
    if x == mpf(2) ** exponent and exponent > -126:
        exponent -= 1
    return mpf(2) ** (exponent - 23)


def within(exact, error):
    return outwards(exact - error, exact + error)


def point(x):
    return (float(x), float(x))


def where(f, y, lo, hi):
    """Finds by bisection the argument at which a monotonic function is y."""
    rising = f(lo) < f(hi)
    for _ in range(200):
        middle = (lo + hi) / 2
        lo, hi = (middle, hi) if (f(middle) < y) == rising else (lo, middle)
    return lo


def between(f, g, x):
    """Like corners, for a function f with an error g. An ulp doubles where f crosses a power of two."""
    lo, hi = sorted(mpf(end) for end in x)
    ends = sorted((f(lo), f(hi)))
    found = [(f(end), g(end, f(end))) for end in (lo, hi)]
    near = min(abs(end) for end in ends)
    if lo < hi and ends[0] * ends[1] > 0:
        power = mpf(2) ** int(mp.ceil(mp.log(max(near, LEAST), 2)))
        if near <= power < max(abs(end) for end in ends):
            power = mp.sign(ends[0]) * power * (1 + mpf(2) ** -100)
            found.append((power, g(where(f, power, lo, hi), power)))
    return outwards(min(y - e for y, e in found), max(y + e for y, e in found))


def corners(f, *intervals):
    """The smallest and the largest result of a monotonic rule, from the ends of its intervals."""
    ends = [[]]
    for interval in intervals:
        ends = [end + [mpf(x)] for end in ends for x in interval]
    found = [f(*end) for end in ends]
    return min(lo for lo, _ in found), max(hi for _, hi in found)


def add(x, y):
    return corners(lambda a, b: outwards(a + b, a + b), x, y)


def sub(x, y):
    return corners(lambda a, b: outwards(a - b, a - b), x, y)


def mul(x, y):
    return corners(lambda a, b: outwards(a * b, a * b), x, y)


def div(x, y):
    if y[0] <= 0 <= y[1] or not all(LEAST <= abs(end) <= 1 / LEAST for end in y):
        raise Unbounded
    return corners(lambda a, b: within(a / b, mpf(2.5) * ulp(a / b)), x, y)


def inverse_sqrt(x):
    if x[0] <= 0:
        raise Unbounded
    return between(lambda a: 1 / mp.sqrt(a), lambda a, y: 2 * ulp(y), x)


def sqrt(x):
    if x[0] < 0:
        raise Unbounded
    return div(point(1), inverse_sqrt(x)) if x[1] > 0 else point(0)


def exponential(f):
    return lambda x: between(f, lambda a, y: (3 + 2 * abs(a)) * ulp(y), x)


exp = exponential(mp.exp)
exp2 = exponential(lambda a: mpf(2) ** a)


def logarithm(f):
    def of(x):
        if x[0] <= 0:
            raise Unbounded
        # Arguments are numbers here, so no interval straddles 1/2 or 2.
        return between(f, lambda a, y: mpf(2) ** -21 if mpf(0.5) <= a <= 2 else 3 * ulp(y), x)

    return of


log = logarithm(mp.log)
log2 = logarithm(lambda a: mp.log(a, 2))


def wave(f):
    def of(x):
        if max(abs(x[0]), abs(x[1])) > mp.pi:
            raise Unbounded
        return corners(lambda a: within(f(a), mpf(2) ** -11), x)

    return of


def power(x, y):
    return exp2(mul(y, log2(x)))


def atan(x):
    return between(mp.atan, lambda a, y: 4096 * ulp(y), x)


def join(x, y):
    return min(x[0], y[0]), max(x[1], y[1])


def mix(x, y, t):
    weighted = add(mul(x, sub(point(1), t)), mul(y, t))
    return join(weighted, add(x, mul(sub(y, x), t)))


def fma(x, y, z):
    return add(mul(x, y), z)


def tan(x):
    return div(wave(mp.sin)(x), wave(mp.cos)(x))


BUILTINS = [
    ("a + b", 2, add), ("a - b", 2, sub), ("a * b", 2, mul), ("a / b", 2, div),
    ("inverseSqrt(a)", 1, inverse_sqrt), ("sqrt(a)", 1, sqrt), ("exp(a)", 1, exp), ("exp2(a)", 1, exp2),
    ("log(a)", 1, log), ("log2(a)", 1, log2), ("pow(a, b)", 2, power), ("sin(a)", 1, wave(mp.sin)),
    ("cos(a)", 1, wave(mp.cos)), ("tan(a)", 1, tan), ("atan(a)", 1, atan), ("fma(a, b, c)", 3, fma),
    ("mix(a, b, c)", 3, mix),
]

EDGES = [1.0, -1.0, 0.5, 2.0, 4.0, 0.25, 3.0, -2.0, single(0x3F800001), single(0x3F7FFFFF)]


def number(chance, text):
    kind = chance.randrange(4)
    if kind == 0:
        x = chance.choice(EDGES)
    elif kind == 1:
        x = chance.uniform(0, 1)
    elif kind == 2:
        x = chance.uniform(-3.1, 3.1)
    else:
        x = chance.choice([-1, 1]) * 2 ** chance.uniform(-20, 20)
    positive = any(name in text for name in ["log", "Sqrt", "sqrt", "pow"])
    return single(bits(abs(x) if positive and chance.randrange(8) else x))


def main():
    for text, count, rule in BUILTINS:
        chance = random.Random(text)
        for _ in range(CASES):
            inputs = [number(chance, text) for _ in range(count)]
            try:
                lo, hi = rule(*[point(x) for x in inputs])
                ends = f"{bits(lo):08x} {bits(hi):08x}"
            except Unbounded:
                ends = "none"
            print(text, "|", " ".join(f"{bits(x):08x}" for x in inputs), "|", ends)


main()
