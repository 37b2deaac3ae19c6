//! What an edit changed of a compute pass: the words that it leaves in each resource, and violations that it brings.

use super::{Change, Compared, PathChange, Request, distance};
use crate::dispatch::{Passes, Violation, common_invocations};
use crate::executor;
use crate::interpret::examine;
use crate::made_up::{Extents, Ranges};
use crate::package::Package;
use crate::value::format_lane;

impl Request {
    /// Dispatches a pass before and after the edit over made-up resources.
    pub(super) fn compare_passes(&self, name: &str) -> Compared {
        let mut compared =
            Compared { dispatched: true, ..Compared::of(name, Change::Same { cases: 0 }) };
        match self.run_passes(name, &mut compared) {
            Ok(change) => Compared { change, ..compared },
            Err(reason) => {
                let reason = reason.replacen("error: ", "", 1);
                let reason = reason.lines().next().unwrap_or_default().to_owned();
                Compared { change: Change::Unjudged { reason }, ..compared }
            }
        }
    }

    fn run_passes(&self, name: &str, compared: &mut Compared) -> Result<Change, String> {
        let ranges = Ranges::of(&self.after).map_err(|error| error.to_string())?;
        let size = |package: &Package| Passes::workgroup_size(package, name);
        let was = size(&self.before).map_err(|error| format!("before: {error}"))?;
        let is = size(&self.after).map_err(|error| format!("after: {error}"))?;
        let invocations = Some(common_invocations([was, is]));
        let mut paths: Vec<PathChange> = Vec::new();
        let mut words = 0;
        for variant in 0..Extents::VARIANTS {
            let made =
                |package: &Package| Passes::arbitrary(package, name, invocations, &ranges, variant);
            let (old, _) = made(&self.before).map_err(|error| format!("before: {error}"))?;
            let (new, made) = made(&self.after).map_err(|error| format!("after: {error}"))?;
            compared.location = new.span().map_or_else(String::new, |span| span.to_string());
            compared.drawn.merge(made.drawn);
            // Draws may bring an index that leaves its array in one of the two alone.
            if variant < Extents::SURE {
                for one in brought(&old, &new) {
                    let known = |known: &Violation| {
                        (known.kind, &known.variable) == (one.kind, &one.variable)
                    };
                    if !compared.violations.iter().any(known) {
                        compared.violations.push(one);
                    }
                }
            }
            for path in &self.paths {
                let run = |passes: &Passes| {
                    let executor = executor::of(*path).map_err(|error| error.to_string())?;
                    executor::dispatch(executor, passes).map_err(|error| error.to_string())
                };
                let difference = Difference::of((&old, run(&old)?), (&new, run(&new)?))?;
                words += difference.words;
                let Some(change) = difference.change(path.to_string(), &made.members) else {
                    continue;
                };
                match paths.iter_mut().find(|known| known.path == change.path) {
                    Some(known) => known.add(change),
                    None => paths.push(change),
                }
            }
            if !made.varies {
                break;
            }
        }
        if words == 0 {
            return Err("it writes nothing that is seen afterwards".to_owned());
        }
        let each = words / self.paths.len().max(1);
        paths.iter_mut().for_each(|path| path.cases.1 = each);
        Ok(match paths.is_empty() {
            true => Change::Same { cases: each },
            false => Change::Changed { paths },
        })
    }
}

/// Violations that the pass after an edit has, and hadn't before.
fn brought(old: &Passes, new: &Passes) -> Vec<Violation> {
    let of =
        |passes: &Passes| examine(passes).violations.into_iter().map(|(violation, _)| violation);
    let before: Vec<Violation> = of(old).collect();
    let is_new = |one: &Violation| {
        before.iter().all(|known| (known.kind, &known.variable) != (one.kind, &one.variable))
    };
    of(new).filter(is_new).collect()
}

/// How words that passes leave differ.
#[derive(Default)]
struct Difference {
    words: usize,
    changed: usize,
    ulp: Option<u64>,
    relative: Option<f64>,
    /// The first element that changed, before and after.
    first: Option<(String, String, String)>,
}

impl Difference {
    fn of(
        (old, was): (&Passes, crate::dispatch::Afterwards),
        (new, is): (&Passes, crate::dispatch::Afterwards),
    ) -> Result<Self, String> {
        let mut all = Self { ulp: Some(0), relative: Some(0.0), ..Self::default() };
        for (number, words) in &is {
            let name = &new.resources[*number].name;
            let text = |error: &dyn std::fmt::Display| error.to_string();
            let (_, shape) = new.written(name).map_err(|error| text(&error))?;
            let lanes = new.lanes(*number, words).unwrap_or_default();
            let short = name.rsplit("::").next().unwrap_or(name);
            let Ok((before, old_shape)) = old.written(name) else {
                return Err(format!("it writes `{short}`, and didn't"));
            };
            if shape != old_shape {
                return Err(format!("`{short}` is {shape}, and was {old_shape}"));
            }
            let before = was.iter().find(|(known, _)| *known == before);
            let before = before.and_then(|(number, words)| old.lanes(*number, words));
            let (scalars, names) = (shape.lanes(), shape.lane_names());
            for (lane, (was, is)) in before.unwrap_or_default().iter().zip(&lanes).enumerate() {
                all.words += 1;
                let Some(far) = distance(scalars[lane], *was, *is) else { continue };
                all.changed += 1;
                let (a, b) = (f64::from(f32::from_bits(*was)), f64::from(f32::from_bits(*is)));
                let share = Some((b - a).abs() / a.abs());
                let share = share.filter(|share| share.is_finite() && scalars[lane].is_float());
                all.ulp = all.ulp.zip(far.ulp()).map(|(most, own)| most.max(own));
                all.relative = all.relative.zip(share).map(|(most, own)| most.max(own));
                all.first.get_or_insert_with(|| {
                    let shown = |word: u32| format_lane(scalars[lane], word);
                    (format!("{short}{}", names[lane]), shown(*was), shown(*is))
                });
            }
        }
        Ok(all)
    }

    /// The change on a path, with the members of uniforms; `None` if nothing changed.
    fn change(self, path: String, members: &[(String, String)]) -> Option<PathChange> {
        let (element, was, is) = self.first?;
        Some(PathChange {
            path,
            cases: (self.changed, self.words),
            ulp: self.ulp,
            relative: self.relative,
            arguments: members.to_vec(),
            before: format!("{element} = {was}"),
            after: is,
        })
    }
}
