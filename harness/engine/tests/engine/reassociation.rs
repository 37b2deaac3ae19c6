//! Tests random programs of floats: for any order of their sums and products, the result is within the bounds.
//!
//! WGSL, 15.7.5 "Reassociation and Fusion": "An implementation may reassociate operations."

use karat_engine::Interval;

use crate::common::{floats, intervals};

const VARIABLES: [&str; 4] = ["x", "y", "z", "w"];
const CONSTANTS: [f32; 8] = [1.0, 2.0, 3.0, 0.5, 0.25, 0.1, 7.3, 289.0];

#[derive(Clone, Debug)]
enum Tree {
    Variable(usize),
    Constant(f32),
    Add(Box<[Tree; 2]>),
    Subtract(Box<[Tree; 2]>),
    Multiply(Box<[Tree; 2]>),
    Divide(Box<[Tree; 2]>),
    Remainder(Box<[Tree; 2]>),
    Negate(Box<Tree>),
    Call(&'static str, Box<Tree>),
    Mix(Box<[Tree; 3]>),
}

struct Random {
    state: u64,
    format: Format,
}

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Single,
    Half,
}

impl Format {
    /// The number of this format that is nearest to `exact`, and its neighbours below and above.
    fn around(self, exact: f64) -> [f32; 3] {
        match self {
            Self::Single => [(exact as f32).next_down(), exact as f32, (exact as f32).next_up()],
            Self::Half => {
                let nearest = half::f16::from_f64(exact);
                // Infinities and NaN have no neighbours. Zero has a negative and a positive neighbour.
                let beside = |up: bool| {
                    let bits = nearest.to_bits();
                    let bits = match (bits & 0x7fff, (bits >> 15 == 1) == up) {
                        (0, _) if up => 1,
                        (0, _) => 0x8001,
                        (0x7c00.., _) => bits,
                        (_, true) => bits - 1,
                        (_, false) => bits + 1,
                    };
                    half::f16::from_bits(bits).to_f32()
                };
                [beside(false), nearest.to_f32(), beside(true)]
            }
        }
    }
}

impl Random {
    fn new(seed: u64, format: Format) -> Self {
        Self { state: seed, format }
    }

    fn below(&mut self, n: usize) -> usize {
        self.state = self
            .state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((self.state >> 33) % n as u64) as usize
    }

    /// A number from -4 to 4, which is near 0 in half of the cases.
    fn number(&mut self) -> f32 {
        let number = self.number_of_single();
        self.format.around(f64::from(number))[1]
    }

    fn number_of_single(&mut self) -> f32 {
        let share = self.below(1 << 24) as f32 / 16_777_216.0;
        let sign = if self.below(2) == 0 { 4.0 } else { -4.0 };
        match self.below(4) {
            0 => sign * share * share * share,
            1 => [0.0, 1.0, -1.0, 2.0, 1e-3, 0.5][self.below(6)],
            _ => sign * share,
        }
    }

    fn tree(&mut self, depth: u32) -> Tree {
        if depth == 0 || self.below(8) == 0 {
            return match self.below(4) {
                0 => {
                    let number = CONSTANTS[self.below(CONSTANTS.len())];
                    // A product of only constants must not overflow in half precision.
                    let number =
                        if self.format == Format::Half { number.min(17.0) } else { number };
                    Tree::Constant(self.format.around(f64::from(number))[1])
                }
                _ => Tree::Variable(self.below(VARIABLES.len())),
            };
        }
        // naga would evaluate a constant expression before the engine sees it.
        let first = match self.tree(depth - 1) {
            Tree::Constant(_) => Tree::Variable(self.below(VARIABLES.len())),
            other => other,
        };
        let two = Box::new([first, self.tree(depth - 1)]);
        let two = if self.below(2) == 0 {
            two
        } else {
            {
                let [a, b] = *two;
                Box::new([b, a])
            }
        };
        match self.below(16) {
            0..=4 => Tree::Add(two),
            5..=7 => Tree::Subtract(two),
            8..=10 => Tree::Multiply(two),
            11 | 12 => Tree::Divide(two),
            13 => Tree::Negate(Box::new(Tree::Add(two))),
            14 => {
                let name = ["abs", "floor", "exp2", "saturate"][self.below(4)];
                Tree::Call(name, Box::new(Tree::Subtract(two)))
            }
            // These functions have no bounds in half precision.
            _ if self.format == Format::Half => Tree::Add(two),
            _ if self.below(4) == 0 => Tree::Remainder(two),
            _ => {
                let [a, b] = *two;
                Tree::Mix(Box::new([a, b, self.tree(depth - 1)]))
            }
        }
    }

    /// Replaces `mix` and `%` in a tree by their formulas, and gives each sum and product a random order.
    fn reassociated(&mut self, tree: &Tree) -> Tree {
        match tree {
            Tree::Variable(_) | Tree::Constant(_) => tree.clone(),
            Tree::Call(name, x) => Tree::Call(name, Box::new(self.reassociated(x))),
            Tree::Add(_) | Tree::Subtract(_) | Tree::Negate(_) | Tree::Mix(_) => {
                let mut terms = Vec::new();
                self.terms(tree, false, &mut terms);
                let (sum, negative) = self.joined(terms, |a, b, differ, a_turned| {
                    let two = |a, b| Box::new([a, b]);
                    match (differ, a_turned) {
                        (false, _) => Tree::Add(two(a, b)),
                        (true, false) => Tree::Subtract(two(a, b)),
                        (true, true) => Tree::Subtract(two(b, a)),
                    }
                });
                if negative { Tree::Negate(Box::new(sum)) } else { sum }
            }
            Tree::Multiply(_) | Tree::Divide(_) => {
                let mut factors = Vec::new();
                self.factors(tree, false, &mut factors);
                let (product, inverse) = self.joined(factors, |a, b, differ, a_turned| {
                    let two = |a, b| Box::new([a, b]);
                    match (differ, a_turned) {
                        (false, _) => Tree::Multiply(two(a, b)),
                        (true, false) => Tree::Divide(two(a, b)),
                        (true, true) => Tree::Divide(two(b, a)),
                    }
                });
                assert!(!inverse, "a product has a factor that isn't a divisor");
                product
            }
            Tree::Remainder(two) => {
                let [x, y] = &**two;
                // The remainder is x - y trunc(x / y). The quotient has its own order.
                let whole = Tree::Call("trunc", Box::new(Tree::Divide(two.clone())));
                let product = Tree::Multiply(Box::new([y.clone(), whole]));
                self.reassociated(&Tree::Subtract(Box::new([x.clone(), product])))
            }
        }
    }

    /// Joins two random terms or factors at a time until one is left. The `bool` of a part is `true` for a term that is
    /// subtracted, and for a divisor.
    fn joined(
        &mut self,
        mut parts: Vec<(Tree, bool)>,
        join: impl Fn(Tree, Tree, bool, bool) -> Tree,
    ) -> (Tree, bool) {
        while parts.len() > 1 {
            let (a, a_turned) = parts.swap_remove(self.below(parts.len()));
            let (b, b_turned) = parts.swap_remove(self.below(parts.len()));
            let joined = join(a, b, a_turned != b_turned, a_turned);
            parts.push((joined, a_turned && b_turned));
        }
        parts.pop().expect("there is a part")
    }

    fn terms(&mut self, tree: &Tree, negative: bool, to: &mut Vec<(Tree, bool)>) {
        match tree {
            Tree::Add(two) => two.iter().for_each(|x| self.terms(x, negative, to)),
            Tree::Subtract(two) => {
                self.terms(&two[0], negative, to);
                self.terms(&two[1], !negative, to);
            }
            Tree::Negate(x) => self.terms(x, !negative, to),
            Tree::Mix(three) => {
                let [x, y, t] = &**three;
                let rest = Tree::Subtract(Box::new([Tree::Constant(1.0), t.clone()]));
                for product in [[x.clone(), rest], [y.clone(), t.clone()]] {
                    self.terms(&Tree::Multiply(Box::new(product)), negative, to);
                }
            }
            Tree::Remainder(two) if self.below(2) == 0 => {
                let whole = Tree::Call("trunc", Box::new(Tree::Divide(two.clone())));
                let product = Tree::Multiply(Box::new([two[1].clone(), whole]));
                self.terms(&two[0], negative, to);
                self.terms(&product, !negative, to);
            }
            other => to.push((self.reassociated(other), negative)),
        }
    }

    fn factors(&mut self, tree: &Tree, divides: bool, to: &mut Vec<(Tree, bool)>) {
        match tree {
            Tree::Multiply(two) => two.iter().for_each(|x| self.factors(x, divides, to)),
            Tree::Divide(two) => {
                self.factors(&two[0], divides, to);
                self.factors(&two[1], !divides, to);
            }
            other => to.push((self.reassociated(other), divides)),
        }
    }

    /// Writes a tree as a WGSL program. Some subexpressions become let-bindings, variables and a function.
    fn written(&mut self, tree: &Tree) -> String {
        let mut body = String::new();
        let result = self.expression(tree, &mut body, true);
        source(&body, &result, self.format)
    }

    fn expression(&mut self, tree: &Tree, body: &mut String, named: bool) -> String {
        let text = match tree {
            Tree::Variable(k) => return VARIABLES[*k].to_owned(),
            Tree::Constant(x) => {
                return format!("{x:?}{}", if self.format == Format::Half { "h" } else { "f" });
            }
            Tree::Negate(x) => format!("(-{})", self.expression(x, body, named)),
            Tree::Call(name, x) => format!("{name}({})", self.expression(x, body, named)),
            Tree::Mix(three) => {
                let of: Vec<String> =
                    three.iter().map(|x| self.expression(x, body, named)).collect();
                format!("mix({})", of.join(", "))
            }
            Tree::Add(two)
            | Tree::Subtract(two)
            | Tree::Multiply(two)
            | Tree::Divide(two)
            | Tree::Remainder(two) => {
                let operator = match tree {
                    Tree::Add(_) => "+",
                    Tree::Subtract(_) => "-",
                    Tree::Multiply(_) => "*",
                    Tree::Divide(_) => "/",
                    _ => "%",
                };
                let [a, b] = [&two[0], &two[1]].map(|x| self.expression(x, body, named));
                let name = format!("v{}", body.len());
                match self.below(6) {
                    0 if named && matches!(tree, Tree::Add(_)) => format!("sum({a}, {b})"),
                    1 if named => {
                        body.push_str(&format!("var {name} = {a}; {name} {operator}= {b};\n"));
                        return name;
                    }
                    _ => format!("({a} {operator} {b})"),
                }
            }
        };
        if named && self.below(4) == 0 {
            let name = format!("v{}", body.len());
            body.push_str(&format!("let {name} = {text};\n"));
            return name;
        }
        text
    }
}

/// The additional error of a quotient, in steps from one float to the next. WGSL allows 2.5 ulp, and rounding to the
/// nearest float already has an error of up to half an ulp.
const ULPS: usize = 2;

impl Random {
    /// The result of a tree if each operation is rounded up or down, and each quotient then has an additional error of
    /// up to [`ULPS`] steps from one float to the next.
    fn rounded(&mut self, tree: &Tree, row: &[f32]) -> f32 {
        let format = self.format;
        let mut of = |x: &Tree| self.rounded(x, row);
        let neighbour = |exact: f64, up: bool| {
            let [below, nearest, above] = format.around(exact);
            match (f64::from(nearest) < exact, f64::from(nearest) > exact) {
                (true, _) if up => above,
                (_, true) if !up => below,
                _ => nearest,
            }
        };
        let exact = match tree {
            Tree::Variable(k) => return row[*k],
            Tree::Constant(x) => return *x,
            Tree::Negate(x) => return -of(x),
            Tree::Call("abs", x) => return of(x).abs(),
            Tree::Call("floor", x) => return of(x).floor(),
            Tree::Call("trunc", x) => return of(x).trunc(),
            Tree::Call("exp2", x) => f64::from(of(x)).exp2(),
            Tree::Call(_, x) => return of(x).clamp(0.0, 1.0),
            Tree::Add(two) => f64::from(of(&two[0])) + f64::from(of(&two[1])),
            Tree::Subtract(two) => f64::from(of(&two[0])) - f64::from(of(&two[1])),
            Tree::Multiply(two) => f64::from(of(&two[0])) * f64::from(of(&two[1])),
            Tree::Divide(two) => {
                let exact = f64::from(of(&two[0])) / f64::from(of(&two[1]));
                let mut quotient = format.around(exact)[1];
                let up = self.below(2) == 0;
                // No implementation returns a quotient with the wrong sign.
                for _ in 0..self.below(ULPS + 1) {
                    if quotient == 0.0 {
                        break;
                    }
                    quotient = format.around(f64::from(quotient))[if up { 2 } else { 0 }];
                }
                return quotient;
            }
            Tree::Remainder(_) | Tree::Mix(_) => unreachable!("it is written out"),
        };
        neighbour(exact, self.below(2) == 0)
    }
}

fn source(body: &str, result: &str, format: Format) -> String {
    if format == Format::Half {
        return format!(
            "enable f16;
            fn sum(a: f16, b: f16) -> f16 {{ return a + b; }}
            fn halves(x: f16, y: f16, z: f16, w: f16) -> f16 {{ {body} return {result}; }}
            fn f(x: f32, y: f32, z: f32, w: f32) -> f32 {{
                return f32(halves(f16(x), f16(y), f16(z), f16(w)));
            }}"
        );
    }
    format!(
        "fn sum(a: f32, b: f32) -> f32 {{ return a + b; }}
        fn f(x: f32, y: f32, z: f32, w: f32) -> f32 {{ {body} return {result}; }}"
    )
}

fn is_narrow(bound: &Interval) -> bool {
    let (lo, hi) = (f64::from(bound.lo()), f64::from(bound.hi()));
    bound.is_bounded() && hi - lo <= lo.abs().max(hi.abs()) / 1024.0
}

const PROGRAMS: usize = 2000;
const CASES: usize = 16;

/// Runs 2,000 programs in `f32`, each in four orders. For each order, a Rust function also computes the result with
/// each operation rounded up or down at random. All results must be within the bounds. Bounds for all orders are wider
/// than bounds for only the written order, but almost as many cases stay bounded.
// Lesson 168: each order of terms lies within the bound
#[test]
fn every_order_of_a_random_program_is_within_the_bounds() {
    // The shares would be 93.5 % and 91.7 % if bounds included only the written order.
    within_the_bounds(Format::Single, [90.5, 88.7]);
}

/// Runs the test above with floats of half precision. In half precision, an ulp is about a thousandth of a number, so
/// few bounds are narrow: 93.3 % of the cases are bounded, but only 19.7 % have narrow bounds.
#[test]
fn every_order_of_a_random_program_of_halves_is_within_the_bounds() {
    within_the_bounds(Format::Half, [90.0, 15.0]);
}

fn within_the_bounds(format: Format, least: [f64; 2]) {
    let mut random = Random::new(5, format);
    let (mut bounded, mut narrow, mut compared) = (0, 0, 0);
    for _ in 0..PROGRAMS {
        let tree = random.tree(4);
        let program = random.written(&tree);
        let rows: Vec<f32> = (0..CASES * VARIABLES.len()).map(|_| random.number()).collect();
        let bounds = intervals(&program, &rows);
        bounded += bounds.iter().filter(|bound| bound.is_bounded()).count();
        narrow += bounds.iter().filter(|bound| is_narrow(bound)).count();
        for _ in 0..4 {
            let twin = random.reassociated(&tree);
            let result = random.expression(&twin, &mut String::new(), false);
            let text = source("", &result, format);
            let cases = rows.chunks(VARIABLES.len()).zip(&bounds);
            for ((row, bound), value) in cases.zip(floats(&text, &rows)) {
                compared += usize::from(bound.is_bounded());
                for value in [value, random.rounded(&twin, row)] {
                    assert!(
                        bound.contains(f64::from(value)),
                        "{value} isn't in {bound:?}, for {row:?}, of\n{program}\nas\n{text}"
                    );
                }
            }
        }
    }
    let per_cent = |of: usize| 100.0 * of as f64 / (PROGRAMS * CASES) as f64;
    let (bounded, narrow) = (per_cent(bounded), per_cent(narrow));
    assert!(compared > 50_000, "{compared}");
    let [least_bounded, least_narrow] = least;
    assert!(
        bounded > least_bounded && narrow > least_narrow,
        "{bounded:.1} % bounded, {narrow:.1} % narrow"
    );
}

fn one(result: &str, row: [f32; 4]) -> Interval {
    intervals(&source("", result, Format::Single), &row)[0]
}

/// If a sum or product overflows only in another order than the written one, its result is unbounded, and
/// `is_reordered` returns `true`.
#[test]
fn an_order_that_overflows_has_no_bound() {
    let large = [3e38, -3e38, 3e38, -3e38];
    for (result, row) in [
        ("x + y + z + w", large),
        ("x + y + z", large),
        ("x * y * z", [1e-30, 1e30, 1e30, 0.0]),
        ("x * y / z", [1e30, 1e-30, 1e-30, 0.0]),
        ("x / y / z", [1e-30, 1e-30, 1e-30, 0.0]),
    ] {
        let found = one(result, row);
        assert!(!found.is_bounded() && found.is_reordered(), "{result}: {found:?}");
    }
    let written = one("x + z", large);
    assert!(!written.is_bounded() && !written.is_reordered(), "it overflows in the only order");
    assert_eq!(one("x + y + z + w", [3.0, -4.0, 5.0, -6.0]), Interval::point(-2.0));
    assert_eq!(one("x * y * z * w", [3.0, -4.0, 5.0, 0.5]), Interval::point(-30.0));
}

/// Subnormal results of operations may be flushed to zero (WGSL, 15.7.2 "Differences from IEEE-754"). A partial sum may
/// also be flushed before the other terms are added.
// Lesson 164
#[test]
fn a_sum_of_some_terms_may_be_flushed() {
    let m = f32::MIN_POSITIVE;
    for (result, row, value) in [
        ("x + y + z", [-m, 1.5 * m, -m, 0.0], -m),
        ("x + y + z + w", [-m, 1.5 * m, -m, 4.0 * m], 3.0 * m),
        ("mix(x, y, z) + x", [-m, 1.5, m, 0.0], -m),
    ] {
        let bound = one(result, row);
        assert!(bound.contains(f64::from(value)), "{result}: {value:e} isn't in {bound:?}");
    }
}

/// Karat doesn't rewrite `(x + y) * w` as `x * w + y * w`, and functions such as `max` keep their arguments.
#[test]
fn only_sums_and_products_have_several_orders() {
    let row = [16_777_216.0, 1.0, -16_777_216.0, 1.0];
    assert_eq!(one("(x + y) + z", row), Interval::between(0.0, 2.0));
    assert_eq!(one("(x + y) * w + z * w", row), Interval::between(0.0, 2.0));
    assert_eq!(one("max(x + y, x) + z", row), Interval::between(0.0, 2.0));
    assert_eq!(one("(y * 0.1 + w * 0.1) * 0.0", row), Interval::point(0.0));
    let factored = one("x * y + x * z", [1e30, 1e20, -1e20, 0.0]);
    assert!(!factored.is_bounded() && !factored.is_reordered(), "each product overflows");
}
