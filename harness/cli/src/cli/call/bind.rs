//! Reads the values of a call's variables and overrides: `--bind NAME=VALUE` and `--override NAME=VALUE`.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, anyhow, bail};
use karat::Package;
use karat::fixture::Fixtures;
use karat::unstable::diagnostic::nearest;
use karat::unstable::probe::Probed;
use karat::unstable::reflect::{BindingKind, Program};
use karat::unstable::value::Scalar;
use karat_inspect::made_up::MadeUp;
use toml::Value;

/// Parses the arguments of `--override`, such as `GAIN=2`.
pub(in crate::cli) fn overrides(given: &[String]) -> anyhow::Result<BTreeMap<String, f64>> {
    let one = |text: &String| {
        let (name, value) = parted("override", text)?;
        let value = match value {
            "true" => 1.0,
            "false" => 0.0,
            number => match karat_suite::hexadecimal(number) {
                Some(number) => number,
                None => number.parse().with_context(|| format!("--override {text}"))?,
            },
        };
        anyhow::Ok((name.to_owned(), value))
    };
    let mut all = BTreeMap::new();
    for text in given {
        let (name, value) = one(text)?;
        if all.insert(name, value).is_some() {
            bail!("two --override options set the same override: remove --override {text}");
        }
    }
    Ok(all)
}

/// Parses the arguments of `--override`. Returns an error if no package has an override with a given name, because the
/// name may be misspelt.
pub(in crate::cli) fn overrides_in(
    packages: &[Package],
    given: &[String],
) -> anyhow::Result<BTreeMap<String, f64>> {
    let given = overrides(given)?;
    match Program::unfit(&packages.iter().collect::<Vec<_>>(), &given) {
        Some((name, wrong)) => bail!("--override {name}: {wrong}"),
        None => Ok(given),
    }
}

/// Returns the given values for the overrides that this package has.
pub(in crate::cli) fn overrides_of(
    package: &Package,
    given: &BTreeMap<String, f64>,
) -> BTreeMap<String, f64> {
    let mut own = given.clone();
    while let Some((name, _)) = Program::unfit(&[package], &own) {
        own.remove(&name);
    }
    own
}

/// Returns an error if `true` or `false` is given for a numeric override.
pub(super) fn expect_types(probed: &Probed, given: &[String]) -> anyhow::Result<()> {
    for text in given {
        let (name, value) = parted("override", text)?;
        let kind = probed.program().override_type(name).filter(|kind| *kind != Scalar::Bool);
        if let ("true" | "false", Some(kind)) = (value, kind) {
            bail!("--override {text}: `{name}` has the type {}, so write a number", kind.wgsl());
        }
    }
    Ok(())
}

fn parted<'a>(option: &str, text: &'a str) -> anyhow::Result<(&'a str, &'a str)> {
    text.split_once('=').with_context(|| format!("--{option} {text}: write NAME=VALUE"))
}

/// Returns a fixture for each variable that a function uses: from `--bind`, or otherwise a generated fixture.
pub(super) fn fixtures(
    probed: &Probed,
    given: &[String],
    made_up: Option<&MadeUp>,
) -> anyhow::Result<Fixtures> {
    let bindings = &probed.function().bindings;
    let mut all = Fixtures::new();
    for text in given {
        let (name, value) = parted("bind", text)?;
        let known = bindings.iter().find(|b| b.name() == name || b.path == name);
        let Some(binding) = known else {
            let near = nearest(name, bindings.iter().map(|b| b.name()));
            let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            bail!("the function `{}` uses no variable `{name}`{near}", probed.function().name);
        };
        if all.iter().any(|(other, _): &(String, _)| {
            other == name || *other == binding.path || other == binding.name()
        }) {
            bail!("the variable `{}` is bound twice: remove --bind {text}", binding.name());
        }
        let value = parsed(value).with_context(|| format!("--bind {text}"))?;
        let fixture = karat_suite::fixture(probed.program(), binding, &value, Path::new(""))
            .map_err(|error| anyhow!("--bind {text}: {error}"))?;
        all.push((name.to_owned(), fixture));
    }
    let own = made_up.into_iter().flat_map(|made_up| &made_up.fixtures);
    let is_given = |path: &str| {
        let known = bindings.iter().find(|b| b.path == path);
        known.is_some_and(|b| all.iter().any(|(name, _)| name == b.name() || *name == b.path))
    };
    let others: Vec<_> = own.filter(|(path, _)| !is_given(path)).cloned().collect();
    all.extend(others);
    let missing = bindings.iter().find(|b| !all.iter().any(|(n, _)| n == b.name() || *n == b.path));
    if let Some(missing) = missing {
        let (name, kind) = (missing.name(), missing.kind);
        let place = missing.span.as_ref().map_or_else(String::new, |span| format!(" ({span})"));
        bail!(
            "the variable `{name}`, a {kind}, is used{place}, but it has no value: add --bind {name}={}, or --arbitrary",
            example(missing.kind)
        );
    }
    Ok(all)
}

fn example(kind: BindingKind) -> &'static str {
    match kind {
        BindingKind::Sampler { comparison: true } => "\"linear less_equal\"",
        BindingKind::Sampler { .. } => "\"linear repeat\"",
        BindingKind::Texture(_) | BindingKind::StorageTexture { .. } => "image.exr",
        _ => "values.json",
    }
}

/// Parses the value in an argument of `--bind`: JSON, numbers joined by commas, or any other text, such as the name of
/// a file.
fn parsed(text: &str) -> anyhow::Result<Value> {
    let json = |text: &str| {
        let value = karat_suite::json(text)?;
        Value::try_from(value).context("`null` isn't a WGSL value")
    };
    if text.starts_with(['{', '[']) {
        return json(text);
    }
    let number = |word: &str| {
        let word = word.trim();
        let float = || karat_suite::hexadecimal(word).or_else(|| word.parse().ok());
        match word.parse::<i64>() {
            Ok(whole) => Some(Value::Integer(whole)),
            Err(_) => float().map(Value::Float).or_else(|| word.parse().ok().map(Value::Boolean)),
        }
    };
    let numbers: Option<Vec<Value>> = text.split(',').map(number).collect();
    Ok(match numbers {
        Some(mut one) if one.len() == 1 => one.remove(0),
        Some(many) => Value::Array(many),
        None => Value::String(text.to_owned()),
    })
}
