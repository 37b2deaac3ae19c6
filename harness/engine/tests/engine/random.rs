//! Compares the results of random programs with those of a simple interpreter of syntax trees, case by case. If
//! interval arithmetic can't decide some conditions, the bounds must contain the results for all values of these
//! conditions.

use std::fmt::Write as _;

use karat_engine::{F32, Intervals, Lane, Options, Resources};

use crate::common::{call, program};

const VARIABLES: usize = 5;

enum Expression {
    Variable(usize),
    Constant(u32),
    Binary(&'static str, Box<Expression>, Box<Expression>),
}

enum Condition {
    Less(Expression, Expression),
    /// A condition that interval arithmetic can't decide. In `f32`, its value is the bit with this number in `bits`.
    Open(u32),
}

enum Statement {
    Assign(usize, Expression),
    Array(Expression, Expression),
    If(Condition, Vec<Statement>, Vec<Statement>),
    Loop(u32, Vec<Statement>),
    Switch(Expression, Vec<Vec<Statement>>),
    Break(Condition),
    Continue(Condition),
    Return(Condition, Expression),
}

struct Random(u64);

impl Random {
    fn below(&mut self, n: u32) -> u32 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as u32) % n
    }

    fn expression(&mut self, depth: u32) -> Expression {
        match self.below(if depth == 0 { 2 } else { 4 }) {
            0 => Expression::Variable(self.below(VARIABLES as u32) as usize),
            1 => Expression::Constant(self.below(9)),
            _ => {
                let operators = ["+", "-", "*", "/", "%", "^", "&", "|"];
                let operator = operators[self.below(8) as usize];
                let (a, b) = (self.expression(depth - 1), self.expression(depth - 1));
                Expression::Binary(operator, Box::new(a), Box::new(b))
            }
        }
    }

    fn condition(&mut self, open: &mut u32) -> Condition {
        if *open < 8 && self.below(3) == 0 {
            *open += 1;
            return Condition::Open(*open - 1);
        }
        Condition::Less(self.expression(1), self.expression(1))
    }

    fn block(&mut self, depth: u32, in_loop: bool, open: &mut u32) -> Vec<Statement> {
        (0..1 + self.below(4)).map(|_| self.statement(depth, in_loop, open)).collect()
    }

    fn statement(&mut self, depth: u32, in_loop: bool, open: &mut u32) -> Statement {
        match self.below(if depth == 0 { 4 } else { 10 }) {
            0..=2 => Statement::Assign(self.below(VARIABLES as u32) as usize, self.expression(2)),
            3 => Statement::Array(self.expression(1), self.expression(1)),
            4 | 5 => {
                let condition = self.condition(open);
                let accept = self.block(depth - 1, in_loop, open);
                let reject = if self.below(2) == 0 {
                    Vec::new()
                } else {
                    self.block(depth - 1, in_loop, open)
                };
                Statement::If(condition, accept, reject)
            }
            6 => Statement::Loop(1 + self.below(5), self.block(depth - 1, true, open)),
            7 => {
                let cases = 1 + self.below(3);
                let selector = self.expression(1);
                let cases = (0..=cases).map(|_| self.block(depth - 1, in_loop, open)).collect();
                Statement::Switch(selector, cases)
            }
            8 if in_loop && self.below(2) == 0 => Statement::Continue(self.condition(open)),
            8 if in_loop => Statement::Break(self.condition(open)),
            _ => Statement::Return(self.condition(open), self.expression(1)),
        }
    }
}

/// The event that ended a block in the interpreter: the block's end, or a jump. `Break` leaves the innermost loop or
/// switch.
enum End {
    Next,
    Break,
    Continue,
    Return(u32),
}

struct Walk {
    variables: [u32; VARIABLES],
    array: [u32; 4],
    bits: u32,
}

impl Walk {
    fn value(&self, expression: &Expression) -> u32 {
        match expression {
            Expression::Variable(k) => self.variables[*k],
            Expression::Constant(x) => *x,
            Expression::Binary(operator, a, b) => {
                let (a, b) = (self.value(a), self.value(b));
                match *operator {
                    "+" => a.wrapping_add(b),
                    "-" => a.wrapping_sub(b),
                    "*" => a.wrapping_mul(b),
                    "/" => a.checked_div(b).unwrap_or(a),
                    "%" => a.checked_rem(b).unwrap_or(0),
                    "^" => a ^ b,
                    "&" => a & b,
                    _ => a | b,
                }
            }
        }
    }

    fn holds(&self, condition: &Condition) -> bool {
        match condition {
            Condition::Less(a, b) => self.value(a) < self.value(b),
            Condition::Open(k) => self.bits >> k & 1 == 1,
        }
    }

    fn block(&mut self, block: &[Statement]) -> End {
        for statement in block {
            let end = self.statement(statement);
            if !matches!(end, End::Next) {
                return end;
            }
        }
        End::Next
    }

    fn statement(&mut self, statement: &Statement) -> End {
        match statement {
            Statement::Assign(k, value) => self.variables[*k] = self.value(value),
            Statement::Array(index, value) => {
                self.array[self.value(index) as usize & 3] = self.value(value);
                self.variables[0] = self.array[self.variables[1] as usize & 3];
            }
            Statement::If(condition, accept, reject) => {
                let block = if self.holds(condition) { accept } else { reject };
                return self.block(block);
            }
            Statement::Loop(rounds, body) => {
                for _ in 0..*rounds {
                    match self.block(body) {
                        End::Break => break,
                        End::Return(value) => return End::Return(value),
                        End::Next | End::Continue => {}
                    }
                }
            }
            Statement::Switch(selector, cases) => {
                let chosen = (self.value(selector) as usize).min(cases.len() - 1);
                match self.block(&cases[chosen]) {
                    End::Break => {}
                    end => return end,
                }
            }
            Statement::Break(condition) if self.holds(condition) => return End::Break,
            Statement::Continue(condition) if self.holds(condition) => return End::Continue,
            Statement::Return(condition, value) if self.holds(condition) => {
                return End::Return(self.value(value));
            }
            _ => {}
        }
        End::Next
    }
}

fn write_expression(expression: &Expression) -> String {
    match expression {
        Expression::Variable(k) => format!("v{k}"),
        // A literal isn't possible, because naga refuses to divide by a constant zero.
        Expression::Constant(x) => format!("(zero + {x}u)"),
        Expression::Binary(operator, a, b) => {
            format!("({} {operator} {})", write_expression(a), write_expression(b))
        }
    }
}

fn write_condition(condition: &Condition, open: bool) -> String {
    match condition {
        Condition::Less(a, b) => format!("{} < {}", write_expression(a), write_expression(b)),
        // sin(pi / 6) is 0.5 within the error of the sine, so the condition is undecided.
        Condition::Open(_) if open => "sin(f32(zero) + 0.52359877) > 0.5".to_owned(),
        Condition::Open(k) => format!("(bits >> {k}u & 1u) == 1u"),
    }
}

fn write_block(block: &[Statement], open: bool, to: &mut String, loops: &mut u32) {
    for statement in block {
        match statement {
            Statement::Assign(k, value) => {
                writeln!(to, "v{k} = {};", write_expression(value)).expect("a string takes all");
            }
            Statement::Array(index, value) => {
                let (index, value) = (write_expression(index), write_expression(value));
                writeln!(to, "a[{index} & 3u] = {value}; v0 = a[v1 & 3u];")
                    .expect("a string takes all");
            }
            Statement::If(condition, accept, reject) => {
                writeln!(to, "if {} {{", write_condition(condition, open))
                    .expect("a string takes all");
                write_block(accept, open, to, loops);
                *to += "} else {\n";
                write_block(reject, open, to, loops);
                *to += "}\n";
            }
            Statement::Loop(rounds, body) => {
                *loops += 1;
                let i = *loops;
                writeln!(to, "for (var i{i} = 0u; i{i} < {rounds}u; i{i}++) {{")
                    .expect("a string takes all");
                write_block(body, open, to, loops);
                *to += "}\n";
            }
            Statement::Switch(selector, cases) => {
                writeln!(to, "switch {} {{", write_expression(selector))
                    .expect("a string takes all");
                for (k, case) in cases.iter().enumerate() {
                    let last = k + 1 == cases.len();
                    if last {
                        *to += "default {\n"
                    } else {
                        writeln!(to, "case {k}u {{").expect("a string takes all")
                    }
                    write_block(case, open, to, loops);
                    *to += "}\n";
                }
                *to += "}\n";
            }
            Statement::Break(condition) => {
                writeln!(to, "if {} {{ break; }}", write_condition(condition, open))
                    .expect("a string takes all");
            }
            Statement::Continue(condition) => {
                writeln!(to, "if {} {{ continue; }}", write_condition(condition, open))
                    .expect("a string takes all");
            }
            Statement::Return(condition, value) => {
                let (condition, value) =
                    (write_condition(condition, open), write_expression(value));
                writeln!(to, "if {condition} {{ return {value}; }}").expect("a string takes all");
            }
        }
    }
}

fn write(block: &[Statement], open: bool) -> String {
    let mut body = String::new();
    write_block(block, open, &mut body, &mut 0);
    let variables: String =
        (0..VARIABLES).map(|k| format!("var v{k} = x * {k}u + {k}u;\n")).collect();
    format!(
        "fn g(x: u32, bits: u32, zero: u32) -> u32 {{
            {variables} var a: array<u32, 4>;
            {body}
            return v0 ^ (v1 * 3u) ^ (v2 * 5u) ^ (v3 * 7u) ^ (v4 * 11u);
        }}
        fn f(x: u32, bits: u32, zero: u32) -> u32 {{ return g(x, bits, zero) + zero; }}"
    )
}

fn walked(block: &[Statement], x: u32, bits: u32) -> u32 {
    let variables = std::array::from_fn(|k| x * k as u32 + k as u32);
    let mut walk = Walk { variables, array: [0; 4], bits };
    match walk.block(block) {
        End::Return(value) => value,
        _ => {
            let [a, b, c, d, e] = walk.variables;
            let times = |x: u32, n: u32| x.wrapping_mul(n);
            a ^ times(b, 3) ^ times(c, 5) ^ times(d, 7) ^ times(e, 11)
        }
    }
}

#[test]
fn random_programs_agree_with_a_tree_interpreter() {
    let mut random = Random(7);
    for _ in 0..300 {
        let mut open = 0;
        let block = random.block(4, false, &mut open);
        let source = write(&block, false);
        let program = program(&source, "f");
        let cases: Vec<(u32, u32)> = (0..40).map(|k| (k % 5, k * 37 % 256)).collect();
        let rows: Vec<u32> = cases.iter().flat_map(|&(x, bits)| [x, bits, 0]).collect();
        let expected: Vec<u32> = cases.iter().map(|&(x, bits)| walked(&block, x, bits)).collect();
        assert_eq!(call::<F32>(&program, cases.len(), &rows).words(), expected, "{source}");
    }
}

#[test]
fn every_way_through_a_random_program_is_within_the_bounds() {
    let mut random = Random(99);
    let (mut found, mut wide) = (0, 0);
    for _ in 0..300 {
        let mut open = 0;
        let block = random.block(4, false, &mut open);
        let source = write(&block, true);
        let program = program(&source, "f");
        let rows: Vec<u32> = (0..5).flat_map(|x| [x, 0, 0]).collect();
        let (resources, options) = (Resources::new(), Options::default());
        let results = program.call::<Intervals>(5, &rows, &resources, &options, &()).unwrap();
        for x in 0..5 {
            let Lane::Int(range) = results.row(x as usize)[0] else { panic!("an integer") };
            for bits in 0..256 {
                let value = i64::from(walked(&block, x, bits));
                assert!(
                    range.lo() <= value && value <= range.hi(),
                    "{value} of {x} and {bits} isn't in {range:?}: {source}"
                );
            }
            found += 1;
            wide += u32::from(range.lo() != range.hi());
        }
    }
    assert!(wide > found / 20, "only {wide} of {found} are open");
}
