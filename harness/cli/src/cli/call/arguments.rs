//! Reads the arguments of a call from the command line: numbers, JSON, derivatives, and at most one sweep.

use anyhow::{Context, anyhow, bail, ensure};
use karat::unstable::diagnostic::nearest;
use karat::unstable::output::counted;
use karat::unstable::reflect::Function;
use karat::unstable::value::{Scalar, Shape};
use karat_suite::hexadecimal;

const MOST_POINTS: u32 = 1 << 22;

pub(super) struct Given {
    /// The lanes of all arguments, in the order of the parameters. A lane is a `u32` with the bits of one scalar. The
    /// derivatives of an argument follow its value.
    pub(super) lanes: Vec<u32>,
    /// For each argument, `true` if it has derivatives.
    pub(super) varying: Vec<bool>,
    pub(super) sweep: Option<Sweep>,
}

/// The component of an argument that a call sweeps, and the values that this component gets in turn.
pub(super) struct Sweep {
    /// The index of the component's lane.
    pub(super) lane: usize,
    pub(super) values: Vec<u32>,
}

impl Given {
    /// Reads the arguments of a function. An argument is `0.5`, `1,0,0`, `0..1:100` (a sweep) or JSON. If the function
    /// uses derivatives, an argument may be `0.5@0.1@0`: the value, its change to the right, and its change downwards.
    /// An argument may begin with the name of its parameter: `x=0.5`.
    pub(super) fn read(function: &Function, arguments: &[String]) -> anyhow::Result<Self> {
        let ordered = ordered(function, arguments)?;
        let mut given = Self { lanes: Vec::new(), varying: Vec::new(), sweep: None };
        for (text, (name, shape)) in ordered.iter().zip(&function.parameters) {
            if is_json(text) {
                let lanes = karat_suite::lanes_of_json(shape, text);
                let lanes = lanes.map_err(|error| anyhow!("argument `{name}`: {error}"))?;
                given.lanes.extend(lanes);
                given.varying.push(false);
                continue;
            }
            let parts: Vec<&str> = text.split('@').collect();
            ensure!(
                matches!(parts.len(), 1 | 3),
                "argument `{name}` needs two derivatives, to the right and downwards: \
                 write `{}@DX@DY`",
                parts[0]
            );
            given.varying.push(parts.len() == 3);
            for part in parts {
                given.value(name, shape, part)?;
            }
        }
        Ok(given)
    }

    fn value(&mut self, name: &str, shape: &Shape, text: &str) -> anyhow::Result<()> {
        let words: Vec<&str> = text.split(',').collect();
        let scalars = shape.lanes();
        ensure!(
            words.len() == scalars.len(),
            "argument `{name}` is a {shape} with {}, but `{text}` has {}{}",
            counted(scalars.len(), "component"),
            words.len(),
            match shape {
                Shape::Struct { .. } => format!("; write the struct as JSON: {}", example(shape)),
                _ => String::new(),
            }
        );
        let of = || format!("argument `{name}`");
        for (word, scalar) in words.iter().zip(scalars) {
            let lane = self.lanes.len();
            match word.split_once("..") {
                None => self.lanes.push(parse(word, scalar).with_context(of)?),
                Some((least, rest)) => {
                    ensure!(self.sweep.is_none(), "a call can have only one sweep: remove a sweep");
                    let values = swept(scalar, least, rest).with_context(of)?;
                    self.lanes.push(values[0]);
                    self.sweep = Some(Sweep { lane, values });
                }
            }
        }
        Ok(())
    }
}

/// Checks if an argument is a structure or list in JSON.
fn is_json(text: &str) -> bool {
    text.trim_start().starts_with(['{', '['])
}

/// Returns the arguments in the order of the parameters.
fn ordered<'a>(function: &Function, arguments: &'a [String]) -> anyhow::Result<Vec<&'a str>> {
    let parameters = &function.parameters;
    let mut found: Vec<Option<&str>> = vec![None; parameters.len()];
    let mut next = 0;
    for text in arguments {
        let (place, value) = match text.split_once('=').filter(|_| !is_json(text)) {
            Some((name, value)) => {
                let place = parameters.iter().position(|(known, _)| known == name.trim());
                let Some(place) = place else {
                    if let Some(binding) = function.bindings.iter().find(|b| b.name() == name) {
                        let kind = binding.kind;
                        bail!("`{name}` is a {kind}, not a parameter: write --bind {name}={value}");
                    }
                    let near = nearest(name, parameters.iter().map(|(known, _)| known.as_str()));
                    let near = near.map_or_else(String::new, |n| format!("; did you mean `{n}`?"));
                    bail!(
                        "the function `{}` has no parameter `{name}`{near}\n  {function}",
                        function.name
                    );
                };
                (place, value)
            }
            None => {
                while found.get(next).is_some_and(Option::is_some) {
                    next += 1;
                }
                (next, text.as_str())
            }
        };
        match found.get_mut(place) {
            Some(slot @ None) => *slot = Some(value),
            Some(Some(_)) => bail!(
                "the call has two arguments for the parameter `{}`: remove one argument",
                parameters[place].0
            ),
            None => break,
        }
    }
    let count = arguments.len();
    let expected = parameters.len();
    ensure!(
        count == expected && found.iter().all(Option::is_some),
        "the function `{}` needs {}, but the call has {count}\n  {function}",
        function.name,
        counted(expected, "argument"),
    );
    Ok(found.into_iter().flatten().collect())
}

/// Returns an example value of a type, as JSON: `{"roughness": 0, "f0": [0, 0, 0]}`.
fn example(shape: &Shape) -> String {
    let list = |one: String, count: usize| format!("[{}]", vec![one; count].join(", "));
    match shape {
        Shape::Scalar(Scalar::Bool) => "false".to_owned(),
        Shape::Scalar(_) => "0".to_owned(),
        Shape::Vector { size, scalar } => list(example(&Shape::Scalar(*scalar)), (*size).into()),
        Shape::Matrix { columns, rows, scalar } => {
            let column = Shape::Vector { size: *rows, scalar: *scalar };
            list(example(&column), (*columns).into())
        }
        Shape::Array { element, length } => list(example(element), *length as usize),
        Shape::Struct { members, .. } => {
            let members =
                members.iter().map(|(name, shape)| format!("\"{name}\": {}", example(shape)));
            format!("{{{}}}", members.collect::<Vec<_>>().join(", "))
        }
    }
}

/// Returns the lanes of the values in `least..most:count`.
fn swept(scalar: Scalar, least: &str, rest: &str) -> anyhow::Result<Vec<u32>> {
    let (most, count) = rest.split_once(':').with_context(|| {
        format!(
            "the sweep `{least}..{rest}` has no number of points: add a number, as in `0..1:100`"
        )
    })?;
    ensure!(
        !most.starts_with('.'),
        "the sweep `{least}..{rest}` has one dot too many: write `{least}..0{most}:{count}`"
    );
    let most = most.strip_prefix('=').unwrap_or(most);
    let count: u32 = count.trim().parse().with_context(|| format!("`{count}` isn't a number"))?;
    ensure!(
        (2..=MOST_POINTS).contains(&count),
        "a sweep can have 2 to {MOST_POINTS} points, but this sweep has {count}"
    );
    let end = |word: &str| Ok::<_, anyhow::Error>(scalar.decode(parse(word, scalar)?));
    ensure!(scalar != Scalar::Bool, "a sweep can't have the type bool: write `true` or `false`");
    let (least, most) = (end(least)?, end(most)?);
    ensure!(least.is_finite() && most.is_finite(), "both ends of a sweep must be finite");
    let distinct = (most - least).abs() + 1.0;
    ensure!(
        scalar.is_float() || f64::from(count) <= distinct,
        "there are only {distinct} integers from {least} to {most}, so a sweep can't have {count} points"
    );
    ensure!(!scalar.is_float() || least != most, "the two ends of a sweep must differ");
    let value = |index: u32| {
        let value = least + (most - least) * f64::from(index) / f64::from(count - 1);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "it lies between two values of the type"
        )]
        match scalar {
            Scalar::F32 => (value as f32).to_bits(),
            Scalar::F16 => half::f16::from_f64(value).to_f32().to_bits(),
            Scalar::I32 => (value.round() as i32).cast_unsigned(),
            Scalar::U32 | Scalar::Bool => value.round() as u32,
        }
    };
    Ok((0..count).map(value).collect())
}

/// Parses a scalar, and returns its lane. Rounds a decimal float to the nearest f32, so a printed f32 gives the same
/// f32 again. Returns an error if a hexadecimal float (`0x1.8p-3`) isn't exactly an f32.
pub(super) fn parse(word: &str, scalar: Scalar) -> anyhow::Result<u32> {
    let word = word.trim();
    let bad = || format!("`{word}` isn't a value of type {}", scalar.wgsl());
    Ok(match scalar {
        Scalar::F32 | Scalar::F16 => {
            let value: f32 = match hexadecimal(word) {
                Some(value) => {
                    #[expect(clippy::cast_possible_truncation, reason = "it is compared below")]
                    let single = value as f32;
                    ensure!(
                        f64::from(single).to_bits() == value.to_bits(),
                        "`{word}` isn't an f32: it has more than 24 binary digits, or is too large"
                    );
                    single
                }
                None => word.parse().with_context(bad)?,
            };
            let value = match scalar {
                Scalar::F16 => half::f16::from_f32(value).to_f32(),
                _ => value,
            };
            // A decimal number that overflows is an error. Users write an infinity as `inf`.
            let digits = word.contains(|c: char| c.is_ascii_digit());
            ensure!(value.is_finite() || !digits, "`{word}` is too large for {}", scalar.wgsl());
            value.to_bits()
        }
        Scalar::I32 => word.parse::<i32>().with_context(bad)?.cast_unsigned(),
        Scalar::U32 => match word.strip_prefix("0x") {
            Some(digits) => u32::from_str_radix(digits, 16).with_context(bad)?,
            None => word.parse::<u32>().with_context(bad)?,
        },
        Scalar::Bool => u32::from(word.parse::<bool>().with_context(bad)?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use karat::unstable::value::hexfloat;

    #[test]
    fn hexfloats_are_parsed() {
        for value in [0.1_f32, 1.0, -0.0, f32::MAX, f32::MIN_POSITIVE, f32::from_bits(1), 1e-40] {
            let text = hexfloat(value);
            assert_eq!(parse(&text, Scalar::F32).expect("it is one"), value.to_bits(), "{text}");
        }
        for wrong in ["0x1.0000001p+0", "0x1p+128", "0x", "0xp1", "0x1.8"] {
            parse(wrong, Scalar::F32).expect_err(wrong);
        }
    }

    #[test]
    fn sweeps_have_their_ends() {
        let values = swept(Scalar::F32, "0", "1:5").expect("a sweep");
        let values: Vec<f32> = values.into_iter().map(f32::from_bits).collect();
        assert_eq!(values, [0.0, 0.25, 0.5, 0.75, 1.0]);
        assert_eq!(swept(Scalar::U32, "3", "=6:4").expect("a sweep"), [3, 4, 5, 6]);
        for (rest, part) in [("1", "number of points"), ("1:1", "2 to"), ("x:3", "f32")] {
            let error = format!("{:#}", swept(Scalar::F32, "0", rest).expect_err(rest));
            assert!(error.contains(part), "{error}");
        }
    }
}
