"""Check a saved set of base parameters with this file, Python, and integers modulo random primes; nothing else.

    python echelon_verify.py set.json        exit codes: 0 valid, 1 NOT valid, 2 not readable, 3 not covered here

*Rows of X.*  By d'Alembert the virtual work of the outputs is Σ m δx·(a − g) over all particles.  A particle p of a body
is at H (p, 1), H its body's 4 × 4 matrix; so a body adds tr(δH J (Ḧ − G)ᵀ), where J = ∫ (p, 1)(p, 1)ᵀ dm is linear in the
ten parameters and g the last column of G.  Each step of a joint is a matrix S with Ṡ = S W and δS = S D; the rest is the
product rule.  A sensor measures along a displacement that never happens.  Random virtual velocities u of the outputs
make one row uᵀX of a random state.
*Numbers.*  Fractions stand for residues modulo a prime of 81 bits that is 23 modulo 24: √2, √3 and multiples of 15°
exist, and 1 + t² is never 0.  An angle is a random point c² + s² = 1, its rational multiples are powers of one c + i s.
*Checks.*  Minimal: a minor of the pivot columns at the stated values is not 0 modulo a prime, so it is not 0.  Complete:
X = (pivot columns of X) B at random points modulo several primes.  A false identity of degree d, integers of b bits,
survives one with probability d/2^80 + (4b/80)/2^71 (zeros; primes that divide it); a character of the file adds at most
128 to d and 512 to b, times the largest power of a c + i s.  In a term there is one sign (as of friction) at most, so X is
linear in signs: points are added until the vectors (1, signs) are independent.
"""
import ast, json, math, re, secrets, sys
from fractions import Fraction
from operator import add, mul, sub, truediv

RANDOM, KINDS = secrets.SystemRandom(), ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
UNITS = dict(zip(KINDS, ["kg·m²"] * 6 + ["kg·m"] * 3 + ["kg"]))
CLASSES = ("unidentifiable", "identifiable alone", "identifiable in combination")
KEYS = "schema echelon name seed rank outputs parameters order base classification reading special generic certificate model"
RAISED, PLAIN = "[⁰¹²³⁴⁵⁶⁷⁸⁹]+", str.maketrans("·−⁰¹²³⁴⁵⁶⁷⁸⁹", "*-0123456789")
TOKENS = r"(?:[0-9]+\.?[0-9]*(?:[eE][+-]?[0-9]{1,3})?|\.[0-9]+|[^\W\d]\w*(?:\[[^]#\n]*\])?|\*\*|[-+*/() ])*"
ONE, ZERO, NONE = [[int(i == j) for j in range(4)] for i in range(4)], [[0] * 4] * 4, (0, 0, 0)
OPERATIONS = {ast.Add: add, ast.Sub: sub, ast.Mult: mul, ast.Div: truediv, ast.UAdd: add, ast.USub: sub}

class Refused(Exception):
    """Why a set is not accepted, and the exit code."""

def need(condition, problem, code=1):
    if not condition:
        raise Refused(f"NOT valid: {problem}" if code == 1 else f"NOT checked: not covered here: {problem}", code)

def only(data, keys):
    need(data.keys() <= {*keys.split()}, "closed loops" if "loops" in data else f"{data.keys() - {*keys.split()}}", 3)
    return data

def evaluate(text, names, function=None):
    """An expression by Python's grammar, of nothing but numbers, names, + − · / ^, and functions of one argument."""
    text = text.strip(" ").replace("^", "**")
    need(len(text) < 10**5 and not re.search("[0-9]{999}", text), "so long an expression", 3)
    def walk(node):
        source = text.encode()[node.col_offset : node.end_col_offset].decode()
        match node:
            case ast.Constant(): return Fraction(source)
            case ast.UnaryOp(op=op, operand=x): return OPERATIONS[type(op)](0, walk(x))
            case ast.BinOp(op=ast.Pow(), left=x, right=y):
                nested = any(isinstance(inner, ast.Pow) for inner in ast.walk(x))
                need(not nested and walk(y) in range(-64, 65), f"the power {source[:60]}", 3)
                return walk(x) ** int(walk(y))
            case ast.BinOp(op=op, left=x, right=y): return OPERATIONS[type(op)](walk(x), walk(y))
            case ast.Call(func=ast.Name(id=name), args=[x], keywords=[]) if function:
                return function(name, text.encode()[x.col_offset : x.end_col_offset].decode())
        return names[re.sub(r"""(?<=\[)[\s"']+|[\s"']+(?=\])""", "", source)]
    if not re.fullmatch(TOKENS, text):
        raise ValueError(f"'{text[:60]}' is no expression")
    return walk(ast.parse(text, mode="eval").body)

def plain(text):
    """2√2·d4²·cos²(a) − 1 as 2*sqrt(2)*d4^2*cos(a)^2 - 1."""
    text = re.sub(rf"\b(cos|sin)({RAISED})(\([^()]*\))", r"\1\3\2", text)
    text = re.sub(r"√([236])", r"sqrt(\1)", re.sub(r"(?<=[0-9])√", "*√", text))
    return re.sub(RAISED, lambda found: "^" + found[0], text).translate(PLAIN)

def twist(w, v=NONE):
    """The 4 × 4 matrix of an angular and a linear velocity."""
    return [[0, -w[2], w[1], v[0]], [w[2], 0, -w[0], v[1]], [-w[1], w[0], 0, v[2]], [0, 0, 0, 0]]

def times(p, *factors):
    """The sum a·b + c·d + ... of products of matrices modulo p."""
    rows = [[x for row in rows for x in row] for rows in zip(*factors[::2])]
    columns = list(zip(*(row for factor in factors[1::2] for row in factor)))
    return [[sum(map(mul, row, column)) % p for column in columns] for row in rows]

def reduced(rows, p):
    """Pivots and rows of the reduced echelon form modulo p."""
    pivots, rows = [], list(rows)
    for column in range(len(rows[0]) if rows else 0):
        k = next((i for i in range(len(pivots), len(rows)) if rows[i][column]), None)
        if k is not None:
            scale, lead = pow(rows[k][column], -1, p), rows.pop(k)
            lead = [x * scale % p for x in lead]
            rows = [[(x - row[column] * y) % p for x, y in zip(row, lead)] if row[column] else row for row in rows]
            rows.insert(len(pivots), lead)
            pivots.append(column)
    return pivots, rows

def random_prime():
    """Of 81 bits and 23 modulo 24; the test is proved for numbers below 3.3e24 (Sorenson and Webster, 2015)."""
    while True:
        p = 2**80 + 24 * RANDOM.randrange(2**80 // 24) + 7  # 2^80 is 16 modulo 24, and (p − 1)/2 is odd
        if all(pow(a, p // 2, p) in (1, p - 1) for a in (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41)):
            return p

def fraction(*signs):
    """A random fraction of any size."""
    return Fraction(RANDOM.choice(signs) * RANDOM.randrange(1, 2**81), 2 ** RANDOM.randrange(61, 102))

class Sample:
    """A random prime and values modulo it of all that the file leaves open: one geometry, and state after state."""

    def __init__(self, data, at_values):
        model = self.model = only(data["model"], "echelon name symbols gravity couplings actuators effects outputs bodies")
        self.p, self.turn = random_prime(), 1
        r2, r3 = (pow(k, (self.p + 1) // 4, self.p) for k in (2, 3))
        self.roots, quarter = {"2": r2, "3": r3, "6": r2 * r3}, Fraction(1, 4)
        texts = {n: s.get("value") if isinstance(s, dict) else s for n, s in model.get("symbols", {}).items()}
        self.symbols = {n: fraction(1) for n in ("gx", "gy", "gz", *texts)}
        self.circles, self.real = {n: self.circle() for n in texts}, {n for n, t in texts.items() if "sqrt" not in str(t)}
        angles = re.findall(r"(?:cos|sin)\((?:\d+\*)?([^()]*)\)", json.dumps(data, ensure_ascii=False))
        stated = {n: t for n, t in texts.items() if t is not None and at_values}
        self.symbols |= {n: evaluate(t, {}, self.function) for n, t in stated.items() if n not in angles and "pi" not in t}
        # an angle is a multiple of 15°, or of the unit of other fractions of π, plus one of the unit of decimals
        parts = {n: [evaluate(t, {"pi": k}) for k in (0, 12)] for n, t in stated.items() if n in angles}
        parts = {n: (b - a, 0, a) if (b - a).denominator == 1 else (0, b - a, a) for n, (a, b) in parts.items()}
        for k, base in enumerate(([self.mod((r2 * r3 + x) * quarter) for x in (r2, -r2)], self.circle(), self.circle())):
            scale = math.lcm(*(Fraction(part[k]).denominator for part in parts.values()))
            unit = Fraction(math.gcd(*(int(part[k] * scale) for part in parts.values())) or 1, scale) if k else 1
            self.circles |= {n: self.power(base, x[k] / unit, self.circles[n] if k else (1, 0)) for n, x in parts.items()}
        gravity = {"none": "000", "generic": ("gx", "gy", "gz")}.get(str(model["gravity"]), model["gravity"])
        self.gravity = [self.read(g) for g in gravity]
        # coordinates and drives as combinations of free coordinates
        motions = [s for b in model["bodies"] for s in only(b["joint"], "type kind name steps")["steps"] if "motion" in s]
        moved = {s["name"]: [f"{s['name']}.{c}" for c in "xyz"] if s["motion"] == "ball" else [s["name"]] for s in motions}
        follow = {n: only(c, "terms")["terms"] for entry in model.get("couplings", []) for n, c in entry.items()}
        drives = {n: only(d, "terms")["terms"] for n, d in model.get("actuators", {}).items()}
        turning = {s["name"] for s in motions if s["motion"] != "translation"}
        self.free = [x for n, names in moved.items() if n not in follow for x in names]
        self.ratios = {x: {x: Fraction(1)} for x in self.free}
        for n, terms in [*follow.items(), *drives.items()]:
            linear = n not in self.ratios and all(x in self.free and isinstance(r, str) for x, r in terms.items())
            rational = linear and not (n in turning and re.search("[^-+0-9./e]", "".join(terms.values())))
            need(linear and rational, f"how {n} depends on others", 3)
            self.ratios[n] = {x: evaluate(r, self.symbols, self.function) for x, r in terms.items()}
        self.fine = math.lcm(*(r.denominator for n in turning & {*follow} for r in self.ratios[n].values()))
        self.driven, self.stated = [x for x in self.free if any(x in terms for terms in drives.values())], list(drives)
        self.drives, self.joints = [*drives, *(x for x in self.free if x not in self.driven)], {*self.free, *follow}
        self.probes, outputs = [], model.get("outputs", [{"actuator": n, "name": n} for n in self.drives])
        self.outputs = [output for entry in outputs for output in self.output(entry)]

    def mod(self, x): return int(x.numerator * pow(x.denominator, -1, self.p) % self.p)

    def read(self, text, names=None): return self.mod(evaluate(text, names or self.symbols, self.function))

    def circle(self):
        t = RANDOM.randrange(self.p)
        return self.mod(Fraction(1 - t * t, 1 + t * t)), self.mod(Fraction(2 * t, 1 + t * t))

    def power(self, point, n, start=(1, 0)):
        """Cosine and sine of an angle plus n times another."""
        (c, s), (a, b), p, n = start, point, self.p, int(n)
        self.turn, b = max(self.turn, abs(n)), b if n > 0 else -b
        for bit in bin(abs(n))[:1:-1]:
            c, s = ((c * a - s * b) % p, (c * b + s * a) % p) if bit == "1" else (c, s)
            a, b = (a * a - b * b) % p, 2 * a * b % p
        return c, s

    def function(self, name, argument):
        if name == "sqrt" and argument in self.roots: return Fraction(self.roots[argument])
        if name in ("sign", "abs"):
            self.met[argument] = 1 if (x := evaluate(argument, self.reals)) > 0 else -1
            return self.met[argument] * (x if name == "abs" else Fraction(1))
        found = re.fullmatch(r"(?:([0-9]+) ?\* ?)?(\S+)", argument)
        need(name in ("cos", "sin") and found and found[2] in self.circles, f"{name}({argument[:60]})", 3)
        return Fraction(self.power(self.circles[found[2]], found[1] or 1)[name == "sin"])

    def frame(self, data):
        """A frame as a matrix, and its inverse."""
        R = [[self.read(x) for x in row] for row in only(data, "xyz rotation").get("rotation", ("100", "010", "001"))]
        S = [[*row, self.read(x)] for row, x in zip(R, data.get("xyz", "000"))] + [ONE[3]]
        *columns, t, _ = *zip(*S), None
        back = [[*c[:3], -sum(map(mul, c[:3], t))] for c in columns] + [ONE[3]]
        det = sum(R[0][i] * (R[1][j] * R[2][k] - R[1][k] * R[2][j]) for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)))
        need(times(self.p, S, back) == ONE and det % self.p == 1, "a rotation of the model is no rotation matrix")
        return S, back

    def output(self, entry):
        """Measured outputs: their names, and weights of virtual velocities v of joints and w of drives."""
        only(entry, "name unit sum joint actuator wrench frame fixed_to components")
        if "wrench" not in entry:
            terms = [(t, self.read(t.get("weight", "1"))) for t in entry.get("sum", [entry])]
            return [(entry["name"], [("v", t["joint"], r) if "joint" in t else ("w", t["actuator"], r) for t, r in terms])]
        (S, back), place, names = self.frame(entry["frame"]), entry["wrench"], [f"{entry['name']}.{c}" for c in entry["components"]]
        place = place if place in [body["name"] for body in self.model["bodies"]] else need(place == "base", "a sensor nowhere")
        for name, c in zip(names, entry["components"]):
            e = [int(c[1] == axis) for axis in "xyz"]
            self.probes.append((place, entry["fixed_to"], name, times(self.p, times(self.p, S, twist(e) if c[0] == "t" else twist(NONE, e)), back)))
        return [(name, []) for name in names]

    def draw(self):
        """A new state, and virtual velocities for random u of the outputs."""
        now = self.now = {(kind, x): fraction(1, -1) for kind in ("q", "qd", "qdd") for x in self.free}
        now |= {("circle", x): self.circle() for x in self.free} | {("i", n): fraction(1, -1) for n in self.ratios}
        now |= {("v", x): 0 for x in self.free} | {("w", a): 0 for a in self.drives}
        self.now = now
        for name, channels in self.outputs:
            now["u", name] = RANDOM.randrange(self.p)
            for kind, place, weight in channels:
                now[kind, place] += now["u", name] * weight
        system = [[*(self.mod(self.ratios[a].get(x, Fraction(0))) for x in self.driven), now["w", a] % self.p] for a in self.stated]
        pivots, solved = reduced(system, self.p)
        need(pivots == [*range(len(self.stated))] == [*range(len(self.driven))], "drives that leave joints open", 3)
        for x in self.free:
            now["v", x] += solved[self.driven.index(x)][-1] if x in self.driven else now["w", x]

    def rate(self, kind, name): return sum(ratio * self.now[kind, x] for x, ratio in self.ratios[name].items())

    def step(self, data):
        """S, Ṡ, S̈ and δS of a frame or an elementary motion."""
        if "motion" not in data: return self.frame(data)[0], ZERO, ZERO, ZERO
        name, kind, axis, p = only(data, "motion name axis pitch")["name"], data["motion"], data["axis"], self.p
        need(kind in ("rotation", "translation", "screw", "ball"), f"a {kind}", 3)
        e, turn, at, a, b = [(c == axis[-1]) * (-1 if axis[0] == "-" else 1) for c in "xyz"], int(kind != "translation"), 0, 0, 0
        slide = self.read(data["pitch"]) if kind == "screw" else 1 - turn
        if kind == "ball":  # by Cayley's parameters e
            e = [RANDOM.randrange(p) for _ in range(3)]
            a = b = self.mod(Fraction(2, 1 + sum(map(mul, e, e))))
            W, dW, D = (twist([self.mod(Fraction(self.now[r, f"{name}.{c}"])) for c in "xyz"]) for r in ("qd", "qdd", "v"))
        else:
            c, at = 1, self.mod(self.rate("q", name))
            for x, ratio in self.ratios[name].items() if turn else ():
                c, a = self.power(self.now["circle", x], ratio * self.fine, (c, a))
            b, speeds = 1 - c, [self.mod(Fraction(self.rate(r, name))) for r in ("qd", "qdd", "v")]
            W, dW, D = (twist([i * turn * r for i in e], [i * slide * r for i in e]) for r in speeds)
        K = twist(e)
        S = times(p, [[x * a for x in row] for row in K], ONE, [[x * b for x in row] for row in K], K, ONE, ONE)
        S = [[*row[:3], i * slide * at % p] for row, i in zip(S, e)] + [ONE[3]]
        return S, times(p, S, W), times(p, times(p, S, W), W, S, dW), times(p, S, D)

    def row(self):
        """uᵀX at a new state, by parameter with its unit."""
        self.draw()
        p, placed, row, half = self.p, {None: (ONE, ZERO, ZERO, ZERO)}, {}, (self.p + 1) // 2
        def sensed(H, V, A, D, place, side):
            for where, fixed_to, name, probe in self.probes:
                if (where, fixed_to) == (place, side):
                    D = times(p, D, ONE, H, [[x * self.now["u", name] for x in r] for r in probe])
            return H, V, A, D
        placed[None] = sensed(*sensed(*placed[None], None, "parent"), None, "body")
        for body in self.model["bodies"]:
            only(body, "name label parent joint massless parameters separate inertial")
            H, V, A, D = sensed(*placed[body.get("parent")], body["name"], "parent")
            for S, dS, ddS, vS in map(self.step, body["joint"]["steps"]):
                D, A = times(p, D, S, H, vS), times(p, A, S, V, dS, V, dS, H, ddS)
                V, H = times(p, V, S, H, dS), times(p, H, S)
            H, V, A, D = placed[body["name"]] = sensed(H, V, A, D, body["name"], "body")
            Q = times(p, list(zip(*D)), [[*r[:3], r[3] - g] for r, g in zip(A, [*self.gravity, 0])])
            trace, axes = half * (Q[0][0] + Q[1][1] + Q[2][2]), ("X", "Y", "Z")
            of = {a + b: -Q[i][j] - Q[j][i] for i, a in enumerate(axes) for j, b in enumerate(axes) if i < j} | {"M": Q[3][3]}
            of |= {"M" + a: Q[i][3] + Q[3][i] for i, a in enumerate(axes)} | {2 * a: trace - Q[i][i] for i, a in enumerate(axes)}
            for kind in [] if body.get("massless") else body.get("parameters", KINDS):
                row[kind + body["label"]] = UNITS[kind], of[kind] % p
        return row | self.effects()

    def effects(self):
        """Powers of the effects; collects the signs that occur."""
        names = {f"{kind}[{n}]": self.rate(kind, n) for kind in ("q", "qd", "qdd") for n in self.ratios}
        names |= {f"i[{n}]": self.now["i", n] for n in self.ratios}
        self.reals, self.signs, row = names | {n: self.symbols[n] for n in self.real}, {}, {}
        for entry in self.model.get("effects", []):
            total = 0
            for act in only(entry, "parameter unit acts value")["acts"]:
                self.met, at = {}, only(act, "at side term")["at"]
                need(at in {"joint": self.joints, "actuator": self.drives}[act["side"]], f"an effect at {at}", 3)
                force = self.read(re.sub(r"(?<![\w\[])(qdd|qd|q|i)(?![\w\[])", rf"\1[{at}]", act["term"]), self.symbols | names)
                total += force * (self.rate("v", at) if act["side"] == "joint" else self.now["w", at])
                need(len(self.met) < 2, "products of signs", 3)
                self.signs |= self.met
            row[entry["parameter"]] = entry["unit"], self.mod(Fraction(total))
        return row

    def rows(self, count):
        """Rows at so many states, and more until the vectors (1, signs) of all are independent."""
        rows, met = [], []
        while len(rows) < count or len(reduced(met, self.p)[0]) < len(met[0]):
            need(len(rows) < 9 * count + 99, "signs in so few regions", 3)
            rows.append(self.row())
            met.append([1, *(self.signs[argument] % self.p for argument in sorted(self.signs))])
        return rows

    def matrix(self, data):
        """The rows of B; with their expressions, read with random values of the parameters, beside them."""
        def value(t): return evaluate(t["coefficient"], self.symbols, self.function) / Fraction(evaluate(t.get("denominator", "1"), self.symbols, self.function))
        rows = [{t["parameter"]: self.mod(value(t)) for t in row["terms"]} for row in data["base"]]
        words = {plain(n): f"_{k}_" for k, n in enumerate(data["parameters"])}
        values = {word: RANDOM.randrange(self.p) for word in words.values()}
        pattern = "|".join(re.escape(n) + r"(?!\w)" for n in sorted(words, key=len, reverse=True))
        for row, terms in zip(data["base"], rows):
            shown = self.read(re.sub(pattern, lambda found: words[found[0]], plain(row["expression"])), self.symbols | values)
            total = sum(x * values[words[plain(n)]] for n, x in terms.items())
            need((shown - total) % self.p == 0, f"the expression of {row['name']} is not the sum of its terms")
        return rows

def check_form(data, sample):
    """What can be read off: names, counts, units, echelon form, classes."""
    row, pivots, order = sample.row(), [row["name"] for row in data["base"]], data["order"]
    need(data["generic"] in (True, False), "'generic' is neither true nor false")
    need(data["schema"] == "echelon.base-model/1", f"the schema {data['schema']}", 3)
    need(len(row) == len(data["parameters"]) and [*row] == data["parameters"], "its parameters are not those of its model")
    need(data["name"] == data["model"]["name"], "its name is not that of its model")
    need(data["outputs"] == [name for name, _ in sample.outputs] and len({*data["outputs"]}) == len(sample.outputs), "its outputs are not those of its model")
    need(data["rank"] == data["certificate"]["rank"] == len(pivots), "its rank is not the number of its rows")
    need(sorted(order) == sorted(row), "the order of its columns is not one of its parameters")
    need(pivots == sorted({*pivots}, key=order.index), "its rows are not in the order of its columns")
    kinds = dict.fromkeys(row, CLASSES[0])
    for base, values in zip(data["base"], sample.matrix(data)):
        name, terms = base["name"], {t["parameter"]: t for t in base["terms"]}
        later = all(n == name or n not in pivots and order.index(n) > order.index(name) for n in terms)
        need(len(terms) == len(base["terms"]) and later and values[name] == 1, f"row {name} is not in echelon form")
        need(base["unit"] == row[name][0], f"the unit of {name} is another one")
        need(all(only(t, "parameter coefficient denominator value") and is_close(t, data["model"]) for t in base["terms"]), f"a value of {name} is another one")
        seen = [n for n, x in values.items() if x]
        kinds |= dict.fromkeys(seen, CLASSES[1 + (len(seen) > 1)])
    classes = {kind: [n for n in row if kinds[n] == kind] for kind in kinds.values()}
    need(data["classification"] == classes, "its classes do not follow from its rows")

def is_close(term, model):
    """Whether the stated value of a coefficient, if its symbols have values, is that in floating point."""
    texts = {n: s.get("value", s.get("approximate")) if isinstance(s, dict) else s for n, s in model.get("symbols", {}).items()}
    known = {n: float(evaluate(t, {"pi": math.pi}, lambda _, k: math.sqrt(int(k)))) for n, t in texts.items() if t is not None}
    def function(name, x): return {"sqrt": math.sqrt, "cos": math.cos, "sin": math.sin}[name](evaluate(x, known))
    try: value = float(evaluate(term["coefficient"], known, function) / evaluate(term.get("denominator", "1"), known, function))
    except KeyError: return term.get("value") is None
    return term.get("value") is not None and math.isclose(term["value"], value, rel_tol=1e-9, abs_tol=1e-12)

def verify(data):
    """What was found, in a sentence; Refused tells why not."""
    own, error, rounds, states = Sample(only(data, KEYS), not data["generic"]), 0, 0, 0
    check_form(data, own)
    pivots = [row["name"] for row in data["base"]]
    while error > -30 * math.log(10):
        sample = Sample(data, False)
        matrix = sample.matrix(data)
        for row in sample.rows(1):
            left = {n: x for n, (_, x) in row.items()}
            for pivot, values in zip(pivots, matrix):
                left |= {n: left[n] - x * row[pivot][1] for n, x in values.items()}
            wrong = [n for n in left if left[n] % sample.p]
            need(not wrong, f"it is not complete: it does not reproduce the effect of {', '.join(wrong[:4])}")
            states += 1
        together = sum(argument not in [f"qd[{x}]" for x in sample.free] for argument in sample.signs)
        size = 128 * sample.turn * len(json.dumps(data)) * 2**together  # such signs depend on several numbers of a point
        need(size < 2**65, "such large multiples of an angle, or so many signs of sums", 3)
        error, rounds = error + math.log(size / 2.0**80 + 16 * size / 80 / 2.0**71), rounds + 1
    rows = own.rows(len(pivots) + 4)
    rank = len(reduced([[row[n][1] for n in pivots] for row in rows], own.p)[0])
    need(rank == len(pivots), f"it is not minimal: of its {len(pivots)} rows only {rank} are independent")
    return (f"valid: {rank} base parameters of {len(left)}; a minor is not 0 modulo a prime, and X = (pivot columns) B at {states} "
            f"states modulo {rounds} primes of 81 bits, error probability below 1e{math.ceil(error / math.log(10))}")

def unique(pairs):
    need(len(dict(pairs)) == len(pairs), "a key stands twice")
    return dict(pairs)

def judge(text: str | bytes) -> tuple[int, str]:
    """The exit code and a sentence for the text of a file."""
    try: return 0, verify(json.loads(text, object_pairs_hook=unique))
    except Refused as error: return error.args[1], error.args[0]
    except RecursionError: return 3, "NOT checked: not covered here: so deep an expression"
    except (ArithmeticError, AttributeError, LookupError, SyntaxError, TypeError, ValueError) as error:
        return 2, f"not readable: {type(error).__name__}: {error}"

if __name__ == "__main__":
    code, sentence = judge(open(sys.argv[1], "rb").read())
    print(sentence)
    sys.exit(code)
