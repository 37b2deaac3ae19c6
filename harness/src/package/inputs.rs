//! `[inputs]` of `karat.toml`: the values that a host passes to a function or a pass.
//!
//! | key | input |
//! |---|---|
//! | `roughness` | each argument and member of this name |
//! | `params.groups` | a member of a variable or an argument |
//! | `"scan::main.groups"` | the argument or member `groups`, but only in the function `scan::main` |
//! | `"length(data)"` | the number of elements of a runtime-sized array |
//! | `"workgroups(scan::main)"` | the total number of workgroups of a pass |
//!
//! | value | allowed values |
//! |---|---|
//! | `0.5` | this number |
//! | `[0, 1]` or `"0..1"` | numbers from the first to the second number |
//! | `{ one_of = [0, 1, 4] }` | one of these numbers |
//! | `"unit_vector"`, `"hemisphere"`, `"unit_rgb"` | vectors of this kind |
//! | `"multiple of 64"` | lengths that are multiples of this number |
//! | `{ range = [0, "length(out) - 1"], distinct = true }` | arrays of different numbers in this range |

use toml::Value;

/// The largest number of elements of a generated array, and the largest generated number of workgroups. 2^22 `u32`s
/// take 16 MiB. With larger arrays, a run takes minutes.
pub const MOST_ELEMENTS: u32 = 1 << 22;

/// The values that a declared input may have.
#[derive(Clone, Debug, PartialEq)]
pub enum Declaration {
    /// The numbers from the first to the second number.
    Range(f64, f64),
    /// One of these numbers.
    Values(Vec<f64>),
    /// Vectors of a kind: `unit_vector`.
    Named(String),
    /// The elements of an array of integers.
    Elements {
        /// The smallest element.
        least: End,
        /// The largest element.
        most: End,
        /// `true` if all elements must differ.
        distinct: bool,
    },
    /// Lengths that are multiples of this number.
    MultipleOf(u32),
}

/// The smallest or largest value that an array's elements may have: `0`, `length(out) - 1`.
#[derive(Clone, Debug, PartialEq)]
pub enum End {
    /// A number.
    Number(f64),
    /// The length of the named array, minus a number.
    Length(String, f64),
}

const KINDS: [&str; 3] = ["unit_vector", "hemisphere", "unit_rgb"];

impl Declaration {
    /// Reads the value of a declared input. If the value is wrong, returns a sentence for the message.
    pub(super) fn of(name: &str, value: &Value) -> Result<Self, String> {
        let is_length = name.contains("length(");
        let wrong = || {
            let what = match is_length || name.contains("workgroups(") {
                true => "a number, a range as in [1, 64], or \"multiple of 64\"",
                false => {
                    "a number, a range as in [0, 1] or \"0..1\", { one_of = [..] }, \"unit_vector\", \"hemisphere\" or \
                     \"unit_rgb\", or { range = [0, \"length(out) - 1\"], distinct = true }"
                }
            };
            format!("the input `{name}` must be {what}, but is {value}")
        };
        let declared = match value {
            Value::Integer(_) | Value::Float(_) => {
                let number = number(value).ok_or_else(wrong)?;
                Self::Range(number, number)
            }
            Value::Array(ends) => match &**ends {
                [least, most] => Self::range(end(least), end(most)).ok_or_else(wrong)?,
                _ => {
                    let count = ends.len();
                    return Err(format!(
                        "the range of the input `{name}` must have two numbers, but has {count}"
                    ));
                }
            },
            Value::String(text) => Self::of_text(text).ok_or_else(wrong)?,
            Value::Table(table) => {
                let known = |key: &String| matches!(&**key, "one_of" | "range" | "distinct");
                if let Some(key) = table.keys().find(|key| !known(key)) {
                    return Err(format!(
                        "the input `{name}` can't have the key `{key}`: write one_of, range or distinct"
                    ));
                }
                let distinct = table.get("distinct").map(Value::as_bool);
                match (table.get("one_of"), table.get("range"), distinct) {
                    (Some(Value::Array(all)), None, None) if !all.is_empty() => {
                        let all = all.iter().map(number).collect::<Option<Vec<_>>>();
                        Self::Values(all.ok_or_else(wrong)?)
                    }
                    (None, range, None | Some(Some(_))) => {
                        let own = match range {
                            None => None,
                            Some(Value::Array(ends)) => match &**ends {
                                [least, most] => Some((end(least), end(most))),
                                _ => return Err(wrong()),
                            },
                            Some(_) => return Err(wrong()),
                        };
                        // Without a range, the elements are indices of their own array.
                        let array = name.rsplit("::").next().unwrap_or(name).to_owned();
                        let (least, most) =
                            own.unwrap_or((Some(End::Number(0.0)), Some(End::Length(array, 1.0))));
                        let (least, most) = (least.ok_or_else(wrong)?, most.ok_or_else(wrong)?);
                        Self::Elements { least, most, distinct: distinct.flatten() == Some(true) }
                    }
                    _ => return Err(wrong()),
                }
            }
            _ => return Err(wrong()),
        };
        let is_size = is_length || name.contains("workgroups(");
        let is_count = |x: f64| x.fract() == 0.0 && (1.0..=f64::from(MOST_ELEMENTS)).contains(&x);
        let fits = |x: f64| x.abs() <= f64::from(f32::MAX);
        match &declared {
            Self::Range(least, most) if is_size && !(is_count(*least) && is_count(*most)) => {
                let what = if is_length { "elements" } else { "workgroups" };
                return Err(format!(
                    "the input `{name}` must be a number of {what} from 1 to {MOST_ELEMENTS}, but is {value}"
                ));
            }
            Self::Values(_) | Self::Named(_) | Self::Elements { .. } if is_size => {
                return Err(wrong());
            }
            Self::Range(least, most) if !(fits(*least) && fits(*most)) => {
                return Err(format!(
                    "the input `{name}` is {value}, which is too large for an f32"
                ));
            }
            _ => {}
        }
        match declared {
            Self::Range(least, most)
                if !(least <= most && least.is_finite() && most.is_finite()) =>
            {
                Err(format!(
                    "the input `{name}` is declared from {least} to {most}, which isn't a range: write the lower end first"
                ))
            }
            Self::MultipleOf(_) if !is_length => Err(wrong()),
            declared => Ok(declared),
        }
    }

    fn of_text(text: &str) -> Option<Self> {
        let text = text.trim();
        if KINDS.contains(&text) {
            return Some(Self::Named(text.to_owned()));
        }
        if let Some(number) = text.strip_prefix("multiple of ") {
            return number.trim().parse().ok().filter(|of| *of > 0).map(Self::MultipleOf);
        }
        let (least, most) = text.split_once("..")?;
        let number = |text: &str| text.trim().parse().ok();
        Some(Self::Range(number(least)?, number(most)?))
    }

    fn range(least: Option<End>, most: Option<End>) -> Option<Self> {
        Some(match (least?, most?) {
            (End::Number(least), End::Number(most)) => Self::Range(least, most),
            (least, most) => Self::Elements { least, most, distinct: false },
        })
    }
}

#[expect(clippy::cast_precision_loss, reason = "ends of 2^53 and above are rounded")]
fn number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|one| one as f64)).filter(|x| x.is_finite())
}

fn end(value: &Value) -> Option<End> {
    let Some(text) = value.as_str() else { return number(value).map(End::Number) };
    let (name, rest) = text.trim().strip_prefix("length(")?.split_once(')')?;
    let less = match rest.trim() {
        "" => 0.0,
        rest => rest.strip_prefix('-')?.trim().parse().ok()?,
    };
    Some(End::Length(name.trim().to_owned(), less))
}

/// The declarations under a name in `[inputs]`, each with its whole key. In TOML, `params.groups = [1, 8]` is a table
/// inside of a table.
pub(super) fn flat(name: &str, value: &Value) -> Result<Vec<(String, Declaration)>, String> {
    let is_own = |table: &toml::Table| {
        table.is_empty()
            || table.keys().any(|key| matches!(&**key, "one_of" | "range" | "distinct"))
    };
    match value {
        Value::Table(table) if !is_own(table) => {
            let all = table.iter().map(|(member, own)| flat(&format!("{name}.{member}"), own));
            Ok(all.collect::<Result<Vec<_>, _>>()?.concat())
        }
        value => Ok(vec![(name.to_owned(), Declaration::of(name, value)?)]),
    }
}

/// Splits a key into the path of a function, if the key names a function, and the name of an input: `scan::main.groups`
/// has the function `scan::main` and the input `groups`. Returns no function for a key with `(`, such as
/// `workgroups(scan)`.
pub fn scope(key: &str) -> (Option<&str>, &str) {
    if key.contains('(') {
        return (None, key);
    }
    match key.rfind("::").and_then(|at| Some(at + key[at..].find('.')?)) {
        Some(dot) => (Some(&key[..dot]), &key[dot + 1..]),
        None => (None, key),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, text: &str) -> Result<Declaration, String> {
        let table: toml::Table = toml::from_str(&format!("x = {text}")).expect("it is TOML");
        Declaration::of(name, &table["x"])
    }

    #[test]
    fn declared_inputs_are_parsed_from_their_values() {
        use Declaration::{Elements, MultipleOf, Named, Range, Values};
        let length = |name: &str, less| End::Length(name.to_owned(), less);
        for (text, expected) in [
            ("0.5", Range(0.5, 0.5)),
            ("[0, 1]", Range(0.0, 1.0)),
            ("\"-1 .. 2.5\"", Range(-1.0, 2.5)),
            ("{ one_of = [0, 4] }", Values(vec![0.0, 4.0])),
            ("\"unit_vector\"", Named("unit_vector".to_owned())),
            (
                "{ distinct = true }",
                Elements { least: End::Number(0.0), most: length("a", 1.0), distinct: true },
            ),
            (
                "[0, \"length(out) - 1\"]",
                Elements { least: End::Number(0.0), most: length("out", 1.0), distinct: false },
            ),
        ] {
            assert_eq!(of("a", text), Ok(expected), "{text}");
        }
        assert_eq!(of("length(a)", "\"multiple of 64\""), Ok(MultipleOf(64)));
        assert_eq!(of("length(a)", "64"), Ok(Range(64.0, 64.0)));
    }

    #[test]
    fn invalid_inputs_say_why() {
        for (text, part) in [
            ("[1, 0]", "from 1 to 0, which isn't a range"),
            ("[0, 1, 2]", "but has 3"),
            ("\"unit vector\"", "\"unit_vector\""),
            ("true", "but is true"),
            ("{ value = 3 }", "the key `value`"),
            ("{ one_of = [] }", "{ one_of = [..] }"),
            ("{ one_of = [\"a\"] }", "{ one_of = [..] }"),
            ("{ distinct = 1 }", "distinct = true"),
            ("[0, \"len(out)\"]", "length(out) - 1"),
            ("\"multiple of 64\"", "a range as in [0, 1]"),
            ("inf", "but is inf"),
        ] {
            let why = of("a", text).expect_err(text);
            assert!(why.contains(part) && why.contains("`a`"), "{text}: {why}");
        }
        let why = of("length(a)", "\"multiple of 0\"").expect_err("of none");
        assert!(why.contains("\"multiple of 64\""), "{why}");
    }

    #[test]
    fn an_input_key_may_begin_with_a_function_name() {
        assert_eq!(scope("groups"), (None, "groups"));
        assert_eq!(scope("params.groups"), (None, "params.groups"));
        assert_eq!(scope("scan::main.params.groups"), (Some("scan::main"), "params.groups"));
        assert_eq!(scope("workgroups(scan::main)"), (None, "workgroups(scan::main)"));
    }
}
