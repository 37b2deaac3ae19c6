//! Collects the numbers with which a program compares its values.

use naga::{BinaryOperator, Block, Expression, Function, Handle, Literal, MathFunction, Statement};

use super::Program;

/// The numbers in a program that may decide its branches: numbers in comparisons, bounds of `clamp`, numbers that the
/// program subtracts, and selectors of `switch` statements. At such a number, or just beside it, an input may make the
/// program take another branch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Literals {
    /// Floats in the text.
    pub floats: Vec<f32>,
    /// Integers in the text.
    pub wholes: Vec<i64>,
}

impl Literals {
    /// The maximum length of `floats`, and of `wholes`, for one program. Karat also tries both neighbours of each
    /// literal.
    const MOST: usize = 16;

    fn add(&mut self, literal: Literal) {
        match literal {
            Literal::F32(x) => self.float(x),
            #[expect(clippy::cast_possible_truncation, reason = "it is compared with an `f32`")]
            Literal::F64(x) | Literal::AbstractFloat(x) => self.float(x as f32),
            Literal::F16(x) => self.float(x.to_f32()),
            Literal::U32(x) => self.whole(i64::from(x)),
            Literal::I32(x) => self.whole(i64::from(x)),
            Literal::AbstractInt(x) | Literal::I64(x) => self.whole(x),
            _ => {}
        }
    }

    fn float(&mut self, x: f32) {
        // Karat always tries 0 and 1.
        if x.is_finite() && x != 0.0 && x != 1.0 && !self.floats.contains(&x) {
            self.floats.push(x);
        }
    }

    fn whole(&mut self, x: i64) {
        if x > 1 && !self.wholes.contains(&x) || x < -1 && !self.wholes.contains(&x) {
            self.wholes.push(x);
        }
    }

    /// Adds the literals of another program to these literals.
    pub fn and(mut self, other: &Self) -> Self {
        other.floats.iter().for_each(|x| self.float(*x));
        other.wholes.iter().for_each(|x| self.whole(*x));
        self
    }
}

impl Program {
    /// The literals of all functions and entry points.
    pub fn literals(&self) -> Literals {
        let module = &self.checked.module;
        let mut all = Literals::default();
        let own = module.functions.iter().map(|(_, function)| function);
        for function in own.chain(module.entry_points.iter().map(|entry| &entry.function)) {
            for (_, expression) in function.expressions.iter() {
                for at in compared(expression).into_iter().flatten() {
                    self.literals_at(function, at, &mut all);
                }
            }
            switched(&function.body, &mut all);
        }
        all.floats.truncate(Literals::MOST);
        all.wholes.truncate(Literals::MOST);
        all
    }

    fn literals_at(&self, function: &Function, at: Handle<Expression>, all: &mut Literals) {
        let module = &self.checked.module;
        let global = |at: Handle<Expression>| match &module.global_expressions[at] {
            Expression::Literal(literal) => Some(*literal),
            Expression::Splat { value, .. } => match &module.global_expressions[*value] {
                Expression::Literal(literal) => Some(*literal),
                _ => None,
            },
            _ => None,
        };
        match &function.expressions[at] {
            Expression::Literal(literal) => all.add(*literal),
            Expression::Constant(constant) => {
                if let Some(literal) = global(module.constants[*constant].init) {
                    all.add(literal);
                }
            }
            Expression::Splat { value, .. } => self.literals_at(function, *value, all),
            Expression::Compose { components, .. } => {
                components.iter().for_each(|one| self.literals_at(function, *one, all));
            }
            Expression::Unary { expr, .. } => {
                let mut own = Literals::default();
                self.literals_at(function, *expr, &mut own);
                own.floats.iter().for_each(|x| all.float(-x));
                own.wholes.iter().for_each(|x| all.whole(-x));
            }
            _ => {}
        }
    }
}

fn compared(expression: &Expression) -> [Option<Handle<Expression>>; 3] {
    match *expression {
        Expression::Binary {
            op:
                BinaryOperator::Equal
                | BinaryOperator::NotEqual
                | BinaryOperator::Less
                | BinaryOperator::LessEqual
                | BinaryOperator::Greater
                | BinaryOperator::GreaterEqual
                | BinaryOperator::Add
                | BinaryOperator::Subtract,
            left,
            right,
        } => [Some(left), Some(right), None],
        Expression::Math {
            fun:
                MathFunction::Min
                | MathFunction::Max
                | MathFunction::Clamp
                | MathFunction::Step
                | MathFunction::SmoothStep,
            arg,
            arg1,
            arg2,
            ..
        } => [Some(arg), arg1, arg2],
        _ => [None; 3],
    }
}

fn switched(block: &Block, all: &mut Literals) {
    for statement in block {
        match statement {
            Statement::Switch { cases, .. } => {
                for case in cases {
                    match case.value {
                        naga::SwitchValue::I32(x) => all.whole(i64::from(x)),
                        naga::SwitchValue::U32(x) => all.whole(i64::from(x)),
                        naga::SwitchValue::Default => {}
                    }
                    switched(&case.body, all);
                }
            }
            Statement::Block(inner) => switched(inner, all),
            Statement::If { accept, reject, .. } => {
                switched(accept, all);
                switched(reject, all);
            }
            Statement::Loop { body, continuing, .. } => {
                switched(body, all);
                switched(continuing, all);
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::package::Package;

    // Lesson 98
    #[test]
    fn literals_in_comparisons_are_found() {
        let text = "const FAR = 100.5; const SIDE = vec2f(3.5);
            fn f(x: f32, k: u32, i: i32, v: vec2f) -> f32 {
                if x > 17.25 || k == 7u { return 2.0 * x; }
                if i < -40 { return 1.0; }
                switch k { case 90u: { return min(x, FAR); } default: {} }
                return max(v, SIDE).x + step(0.25, x) + clamp(x, 0.0, 1.0) - 5.0;
            }";
        let program =
            Program::of_module(&Package::from_source("m", text), "").expect("it is valid");
        let Literals { floats, wholes } = program.literals();
        assert_eq!((floats, wholes), (vec![17.25, 100.5, 3.5, 0.25, 5.0], vec![7, -40, 90]));
    }
}
