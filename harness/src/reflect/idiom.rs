//! Operations that many shaders write alike, and that go wrong alike in all of them.

use naga::{BinaryOperator, Expression, Function, Handle, Literal, MathFunction, ScalarKind};

use super::Program;

/// An operation that many shaders have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Idiom {
    /// A sine, a cosine, the inverse of one, or a determinant.
    Builtin,
    /// A power whose exponent is a constant above 0.
    Power,
    /// `fract(x)`, `floor(x)`, or `x` less a whole number that `floor` gives, such as `x - floor(x / n) * n`.
    Remainder,
    /// The bits of a number that is read as a float.
    Bits,
    /// The bits of a number that its author wrote: `bitcast<f32>(0x7f800000u)`.
    WrittenBits,
    /// `clamp`.
    Clamp,
    /// A constant less a product: `1.0 - x * x`.
    Complement,
    /// A quotient.
    Quotient,
    /// A product, or a power with another exponent.
    Product,
    /// An element by the counter of a loop whose end is no constant: `a[i]` under `i < count`.
    Counted,
}

impl Program {
    /// The idiom that an expression of a function, by its index, is.
    pub(crate) fn idiom(&self, function: &str, expression: usize) -> Option<Idiom> {
        let module = &self.checked.module;
        let mut functions = module.functions.iter().map(|(_, function)| function);
        let function = functions.find(|known| known.name.as_deref() == Some(function))?;
        let (at, _) = function.expressions.iter().nth(expression)?;
        let of = |at: Handle<Expression>| &function.expressions[at];
        let is_floor = |at: Handle<Expression>| {
            matches!(of(at), Expression::Math { fun: MathFunction::Floor, .. })
        };
        match *of(at) {
            Expression::Math {
                fun:
                    MathFunction::Sin
                    | MathFunction::Cos
                    | MathFunction::Asin
                    | MathFunction::Acos
                    | MathFunction::Determinant,
                ..
            } => Some(Idiom::Builtin),
            Expression::Math { fun: MathFunction::Pow, arg1: Some(exponent), .. } => {
                let is_positive = self.is_positive(function, exponent);
                Some(if is_positive { Idiom::Power } else { Idiom::Product })
            }
            Expression::Math { fun: MathFunction::Fract | MathFunction::Floor, .. } => {
                Some(Idiom::Remainder)
            }
            Expression::Math { fun: MathFunction::Clamp, .. } => Some(Idiom::Clamp),
            Expression::Access { .. }
            | Expression::AccessIndex { .. }
            | Expression::Load { .. } => is_counted(function, at).then_some(Idiom::Counted),
            Expression::Binary { op: BinaryOperator::Subtract, left, right }
                if self.is_positive(function, left) && is_product(of(right)) =>
            {
                Some(Idiom::Complement)
            }
            Expression::Binary { op: BinaryOperator::Subtract, right, .. } => {
                let is_whole = match *of(right) {
                    Expression::Binary { op: BinaryOperator::Multiply, left, right } => {
                        is_floor(left) || is_floor(right)
                    }
                    _ => is_floor(right),
                };
                is_whole.then_some(Idiom::Remainder)
            }
            Expression::Binary { op: BinaryOperator::Divide | BinaryOperator::Modulo, .. } => {
                Some(Idiom::Quotient)
            }
            Expression::Binary { op: BinaryOperator::Multiply, .. } => Some(Idiom::Product),
            Expression::Math { fun: MathFunction::Unpack2x16float, arg, .. } => {
                is_read(of(arg)).then_some(Idiom::Bits)
            }
            Expression::As { expr, kind: ScalarKind::Float, convert: None }
                if matches!(of(expr), Expression::Literal(_) | Expression::Constant(_)) =>
            {
                Some(Idiom::WrittenBits)
            }
            Expression::As { expr, kind: ScalarKind::Float, convert: None } => {
                is_read(of(expr)).then_some(Idiom::Bits)
            }
            _ => None,
        }
    }

    /// True of a constant above 0, in each component.
    fn is_positive(&self, function: &Function, at: Handle<Expression>) -> bool {
        let module = &self.checked.module;
        let literal = |literal: &Literal| match *literal {
            Literal::F32(x) => x > 0.0,
            Literal::F64(x) | Literal::AbstractFloat(x) => x > 0.0,
            Literal::F16(x) => x > half::f16::ZERO,
            _ => false,
        };
        match &function.expressions[at] {
            Expression::Literal(own) => literal(own),
            Expression::Splat { value, .. } => self.is_positive(function, *value),
            Expression::Compose { components, .. } => {
                components.iter().all(|one| self.is_positive(function, *one))
            }
            Expression::Constant(constant) => {
                let init = module.constants[*constant].init;
                match &module.global_expressions[init] {
                    Expression::Literal(own) => literal(own),
                    Expression::Splat { value, .. } => {
                        matches!(&module.global_expressions[*value], Expression::Literal(own) if literal(own))
                    }
                    _ => false,
                }
            }
            _ => false,
        }
    }
}

/// True of a product, a square of a vector or a power.
fn is_product(expression: &Expression) -> bool {
    match expression {
        Expression::Binary { op, .. } => *op == BinaryOperator::Multiply,
        Expression::Math { fun, .. } => matches!(fun, MathFunction::Dot | MathFunction::Pow),
        _ => false,
    }
}

/// True of a number that isn't computed: an argument, a variable, or a part of one.
fn is_read(expression: &Expression) -> bool {
    matches!(
        expression,
        Expression::Load { .. }
            | Expression::Access { .. }
            | Expression::AccessIndex { .. }
            | Expression::FunctionArgument(_)
    )
}

/// True of an element whose index is a variable that is compared with what is no constant, and with nothing else.
fn is_counted(function: &Function, at: Handle<Expression>) -> bool {
    let of = |at: Handle<Expression>| &function.expressions[at];
    let index = match *of(at) {
        Expression::Access { index, .. } => index,
        Expression::AccessIndex { base: of, .. } | Expression::Load { pointer: of } => {
            return is_counted(function, of);
        }
        _ => return false,
    };
    let counter = |at: Handle<Expression>| match *of(at) {
        Expression::Load { pointer } => match *of(pointer) {
            Expression::LocalVariable(variable) => Some(variable),
            _ => None,
        },
        _ => None,
    };
    let Some(own) = counter(index) else { return false };
    let ends = function.expressions.iter().filter_map(|(_, one)| match *one {
        Expression::Binary {
            op:
                BinaryOperator::Less
                | BinaryOperator::LessEqual
                | BinaryOperator::Greater
                | BinaryOperator::GreaterEqual
                | BinaryOperator::NotEqual,
            left,
            right,
        } => match (counter(left) == Some(own), counter(right) == Some(own)) {
            (true, _) => Some(right),
            (_, true) => Some(left),
            _ => None,
        },
        _ => None,
    });
    let is_constant = |at| {
        matches!(of(at), Expression::Literal(_) | Expression::Constant(_) | Expression::Override(_))
    };
    let ends: Vec<bool> = ends.map(is_constant).collect();
    !ends.is_empty() && !ends.contains(&true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::package::Package;

    #[test]
    fn an_idiom_is_the_whole_operation() {
        for (text, expected) in [
            ("sin(a)", Some(Idiom::Builtin)),
            ("cos(a) - 1.0", None),
            ("pow(1.0 - max(a, b), 5.0)", Some(Idiom::Power)),
            ("pow(v, vec3f(2.4))", Some(Idiom::Power)),
            ("pow(v, vec3f(1.0 / 3.0))", Some(Idiom::Power)),
            ("pow(a, GAMMA)", Some(Idiom::Power)),
            ("pow(v, vec3f(2.0, 0.0, 1.0))", Some(Idiom::Product)),
            ("pow(a, b)", Some(Idiom::Product)),
            ("pow(a, 0.0)", Some(Idiom::Product)),
            ("pow(a, -2.0)", Some(Idiom::Product)),
            ("exp(a)", None),
            ("a - floor(a * (1.0 / 289.0)) * 289.0", Some(Idiom::Remainder)),
            ("a - b * floor(a / b)", Some(Idiom::Remainder)),
            ("floor(a) - b", None),
            ("1.0 - a * a", Some(Idiom::Complement)),
            ("1.0 - dot(v, v)", Some(Idiom::Complement)),
            ("vec3f(1.0) - v * v", Some(Idiom::Complement)),
            ("vec3f(1.0) - v", None),
            ("a - 1.0", None),
            ("normalize(v)", None),
            ("fract(a) - fract(b)", None),
            ("fract(dot(v, v) * 3.0)", Some(Idiom::Remainder)),
            ("bitcast<f32>(word)", Some(Idiom::Bits)),
            ("bitcast<f32>(words[word + 3u])", Some(Idiom::Bits)),
            ("bitcast<f32>(0x5f3759dfu - (word >> 1u))", None),
            ("bitcast<f32>(0x7f800000u)", Some(Idiom::WrittenBits)),
            ("unpack2x16float(word)", Some(Idiom::Bits)),
            ("unpack2x16float(word ^ 3u)", None),
            ("bitcast<f32>(word) / a", Some(Idiom::Quotient)),
            ("clamp(a, b, 1.0)", Some(Idiom::Clamp)),
            ("smoothstep(a, b, 1.0)", None),
            ("1.0 / a", Some(Idiom::Quotient)),
            ("a % (b - v.x)", Some(Idiom::Quotient)),
            ("v / (b * b)", Some(Idiom::Quotient)),
            ("a * b", Some(Idiom::Product)),
            ("1.0 + a / b", None),
        ] {
            let source = format!(
                "const GAMMA = 2.2;\nvar<private> words: array<u32, 4>;\n\
                 fn f(a: f32, b: f32, v: vec3f, word: u32) {{ let own = {text}; }}"
            );
            let program = Program::of_module(&Package::from_source("m", source), "");
            let program = program.expect(text);
            let module = &program.checked.module;
            let (_, function) = module.functions.iter().next().expect("it has one");
            let (expression, _) = function.named_expressions.iter().last().expect("it has a name");
            let name = function.name.as_deref().expect("it has a name");
            assert_eq!(program.idiom(name, expression.index()), expected, "{text}");
        }
    }
}
