//! Tests that a TOML file declares: `brdf.test.toml`, beside `brdf.wgsl`.
//!
//! ```toml
//! [[test]]
//! function = "schlick"                          # in this module; "other::f" is in another module
//! over = { f0 = "0..1", v_dot_h = "0..1" }      # names and types give the other domains
//! where = "f0 <= v_dot_h"                       # tests only arguments for which this is true
//! in_range = [0, 1]                             # each assertion is a test
//! monotone = { v_dot_h = "decreasing" }
//! agrees_with = "reference::schlick"            # another function, executed in f64
//! tolerance = "4 ulp"                           # or "rel 1e-4 or abs 1e-6", or "spec"
//!
//! [[test]]
//! function = "luminance"
//! table = "luminance.csv"                       # columns rgb.x, rgb.y, rgb.z, result
//! tolerance = "2 ulp"
//!
//! [[frame]]
//! name = "gradient"
//! vertex = "vs_main"
//! fragment = "fs_main"
//! size = [64, 64]                               # compared with golden/gradient.exr
//! ```
//!
//! A `fragment` function alone draws every pixel of the frame. With a `vertex` function, a frame draws triangles.
//! `draws` makes several draws. Each draw has its own functions, a `mesh` (a table of vertices) or a number of
//! `vertices`, and state (`depth_compare`, `blend`). A frame may set `samples`, `formats` (one format for each
//! location, such as `"float"` and `"rgba8unorm-srgb"`), the compared target (`target = 1`, or `depth = true`),
//! `tolerance` (a relative difference, `1e-3`), `fails_on`, `refused_on`, `module`, and the folder of its `golden`.
//!
//! `with = { exposure = 2, albedo = "wood.png" }` binds variables that the function reads. `override = { GAIN = 2 }`
//! sets overrides.
//!
//! | assertion | holds if |
//! |---|---|
//! | `agrees_with = "f"` | the results equal those of another function, which Karat's engine executes in `f64` |
//! | `table = "file.csv"` | the results equal those in the file; each row has the arguments and the result of one call |
//! | `golden = "name"` | the results equal the accepted ones in `golden/name.csv` |
//! | `equals = 1.0` | each result is this value |
//! | `finite = true` | no component of a result is NaN or infinite |
//! | `unit = true` | each result is a vector of length 1 |
//! | `perpendicular_to = "n"` | each result is a vector at right angles to this argument |
//! | `right_handed_frame = true` | each result has three unit vectors at right angles, and the third is the cross product of the first two |
//! | `in_range = "0..1"` or `[0, 1]`, `in_range = "0..<1"` | each component of a result is in the range; `..<` excludes the end |
//! | `symmetric_in = ["v", "l"]` | swapping the two arguments doesn't change the result |
//! | `monotone = { x = "increasing" }` | the result never falls as `x` rises |
//! | `limit = { alpha = 0, through = [0.1, 0.01], equals = 1 }` | the result approaches 1 as `alpha` goes to 0 |
//! | `integral = { over = "hemisphere", equals = 1 }` | the integral over the last argument, which is a direction, is 1; `at_most` sets an upper bound instead |
//! | `no_hazards = true` | no operation in the function has a hazard |
//! | `no_hazards = ["nan", "out_of_range"]` | no operation in the function has a hazard of these kinds |
//!
//! An entry point is a function, too: `function = "fs_main"` calls it with its inputs. Compute passes are dispatched:
//!
//! ```toml
//! [[compute]]
//! entry = "sort"                                # in this module; or passes = [{ entry = "..", workgroups = 4 }]
//! workgroups = [4, 1, 1]                        # or 4
//! with = { keys = { size = 256, range = "0..99" } }
//! accept_equal_writes = { flag = "any of them sets it" }   # an accepted race; or accept_race
//! [compute.after.keys]                          # the expected contents after the passes
//! sorted = true                                 # or "descending"
//! permutation_of = "keys"                       # of the buffer's contents before the passes
//! ```
//!
//! | assertion of a resource | holds if |
//! |---|---|
//! | `equals = [1, 2]` | the resource has this value; a single number is the value of each component |
//! | `table = "file.csv"` | the elements equal the rows of the file, whose columns are `x,y,z` or `value` |
//! | `golden = "name"` | the contents equal the accepted ones in `golden/name.csv` |
//! | `agrees_with = "entry"` | the contents are the same if the last pass runs this entry point instead, in Karat's engine |
//! | `sorted = true` | the elements are in ascending order; with `"descending"`, in descending order |
//! | `sum_of = "input"` | the numbers have the same sum as those that the buffer `input` contains before the passes |
//! | `permutation_of = "input"` | the elements are those that the buffer `input` contains before the passes, in any order |
//! | `unchanged = true` | the passes don't change the contents |
//! | `written = true` | the invocations write each element of the buffer, or each texel of the texture |
//! | `in_range = [0, 1]`, `finite = true` | each component is in the range; each component is finite |
//!
//! The key `no_hazards = true` of a `[[compute]]` asserts that no operation in the passes has a hazard, such as NaN or
//! a division by 0. A list of kinds, such as `no_hazards = ["nan"]`, asserts this only for these kinds. Without a
//! `tolerance`, numbers are compared exactly. The sanitizer checks the passes of each test.

use std::collections::BTreeMap;
use std::fmt;
use std::ops;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use karat::check::HazardKind;
use karat::unstable::diagnostic::{Diagnostic, SourceFile, Span, nearest, read_file, shown};
use karat::unstable::record::Subject;
use karat::unstable::value::Shape;
use serde::Deserialize;
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Value};

use crate::assertions::{Shared, What, idle_key, switched};
use crate::compute;
use crate::draws;
use crate::find::of_whole;
use crate::range::Range;
use crate::wrong::Misdeclared;
use crate::{Kind, Test};

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default, rename = "test")]
    tests: Vec<Spanned<Declared>>,
    #[serde(default, rename = "frame")]
    frames: Vec<Spanned<Frame>>,
    #[serde(default)]
    compute: Vec<Spanned<compute::Declared>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Declared {
    /// The test's name. The default is the function's name.
    name: Option<String>,
    /// The function that the test calls: a name in the module beside the file, such as `schlick`, or a path such as
    /// `brdf::schlick`.
    pub(crate) function: String,
    /// The domain of each argument: `{ x = "0..1", n = "unit_vector" }`.
    #[serde(default)]
    pub(crate) over: BTreeMap<String, Value>,
    /// The condition that arguments must meet, as a WGSL expression: `"a < b"`. Karat tests no other arguments.
    #[serde(rename = "where")]
    pub(crate) filter: Option<String>,
    /// The number of cases. The default is 65536, and fewer for an integral.
    pub(crate) cases: Option<u64>,
    /// The seed of the cases. The default depends on the test's name.
    pub(crate) seed: Option<u64>,
    /// The largest error that passes: `"4 ulp"`, `"rel 1e-4"`, `"abs 1e-6"`, `"exact"`, `"spec"`, or several joined by
    /// `or`.
    pub(crate) tolerance: Option<String>,
    /// Tolerances for single paths: `{ gl = "abs 1e-3" }`.
    #[serde(default)]
    pub(crate) tolerance_on: BTreeMap<String, String>,
    /// Paths on which the test must fail, each with the reason: `{ gl = "clamps faces" }`.
    #[serde(default)]
    pub(crate) fails_on: BTreeMap<String, String>,
    /// Paths that can't run the test, each with the reason. These paths must refuse the test.
    #[serde(default)]
    pub(crate) refused_on: BTreeMap<String, String>,
    /// Textures, samplers and buffers, each under its variable's name.
    #[serde(default)]
    pub(crate) with: BTreeMap<String, Value>,
    /// The values of `override`s, by their names or numbers.
    #[serde(default, rename = "override")]
    pub(crate) overrides: BTreeMap<String, OverrideValue>,
    /// Asserts that another WGSL function, which Karat executes in `f64`, returns the same result.
    agrees_with: Option<String>,
    /// Asserts that the results equal those in this CSV file. Each row has the arguments and the result of one call.
    table: Option<PathBuf>,
    /// Asserts that the results equal the accepted ones in `golden/NAME.csv`, which `karat accept` writes.
    golden: Option<String>,
    /// Asserts that each result is this value.
    equals: Option<Value>,
    /// Asserts that no component of a result is NaN or infinite: `true`.
    finite: Option<bool>,
    /// Asserts that each result is a vector of length 1: `true`.
    unit: Option<bool>,
    /// Asserts that each result is a vector at right angles to this argument. A zero vector has no angle, and fails.
    perpendicular_to: Option<String>,
    /// Asserts that each result has three unit vectors at right angles, and that the third is the cross product of the
    /// first two: `true`. The vectors are the columns of a `mat3x3f` or the members of a structure.
    right_handed_frame: Option<bool>,
    /// Asserts that each component of a result is in this range: `"0..1"`, `[0, 1]`, or `"0..<1"`, which excludes the
    /// end.
    in_range: Option<Range>,
    /// Asserts that swapping these two arguments doesn't change the result.
    symmetric_in: Option<Pair<String>>,
    /// Asserts that the result only rises, or only falls, with an argument: `{ x = "increasing" }`.
    monotone: Option<BTreeMap<String, Direction>>,
    /// Asserts that the result approaches a value: `{ alpha = 0, through = [0.1, 0.01], equals = 1 }`.
    limit: Option<BTreeMap<String, Value>>,
    /// Asserts the value of the integral over the last argument, which is a direction. The keys of `integral` have
    /// their own table.
    integral: Option<Integral>,
    /// Asserts that no operation in the function has a hazard: `true`, or a list of kinds: `["nan", "out_of_range"]`.
    /// The function must not write storage.
    no_hazards: Option<NoHazards>,
    /// Operations whose hazards `no_hazards` accepts, each with the reason: `{ "1.0 / x" = "x isn't 0" }`.
    #[serde(default)]
    pub(crate) accept_hazard: BTreeMap<String, String>,
}

/// The largest relative difference that a pixel may have: `1e-3` or `"rel 1e-3"`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Value")]
pub(crate) struct Relative(pub(crate) f32);

impl TryFrom<Value> for Relative {
    type Error = &'static str;

    fn try_from(value: Value) -> Result<Self, Self::Error> {
        let number = match &value {
            #[expect(clippy::cast_possible_truncation, reason = "bounds of pixels are f32")]
            Value::Float(number) => Some(*number as f32),
            #[expect(clippy::cast_precision_loss, reason = "larger tolerances are useless")]
            Value::Integer(number) => Some(*number as f32),
            Value::String(text) => {
                text.strip_prefix("rel ").and_then(|text| text.trim().parse().ok())
            }
            _ => None,
        };
        let wanted = "a frame's tolerance is the largest relative difference that a pixel may have: write 1e-3, or \
                      \"rel 1e-3\"";
        number.map(Self).ok_or(wanted)
    }
}

/// A list of exactly two elements. If the type were an array, Serde would accept a longer list, and silently ignore the
/// other elements.
#[derive(Clone, Debug, Deserialize)]
#[serde(try_from = "Vec<T>")]
pub(crate) struct Pair<T>(pub(crate) [T; 2]);

impl<T> TryFrom<Vec<T>> for Pair<T> {
    type Error = String;

    fn try_from(list: Vec<T>) -> Result<Self, String> {
        list.try_into().map(Self).map_err(|list: Vec<T>| {
            format!("the list must have two entries, but has {}", list.len())
        })
    }
}

/// The kinds of hazards that must not occur: a list of kinds, or `true` for all kinds.
#[derive(Clone, Debug, Deserialize)]
#[serde(try_from = "Value")]
pub(crate) struct NoHazards(pub(crate) Option<Vec<HazardKind>>);

impl TryFrom<Value> for NoHazards {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        match value {
            Value::Boolean(true) => Ok(Self(None)),
            Value::Boolean(false) => {
                Err("`no_hazards = false` asserts nothing: remove the key".to_owned())
            }
            Value::Array(kinds) if kinds.is_empty() => {
                Err("`no_hazards = []` asserts nothing: name kinds, or write `true`".to_owned())
            }
            Value::Array(kinds) => {
                let kind = |kind: Value| {
                    let known = kind.try_into();
                    known.map_err(|error: toml::de::Error| with_nearest(error.message()))
                };
                let kinds = kinds.into_iter().map(kind).collect::<Result<_, _>>()?;
                Ok(Self(Some(kinds)))
            }
            other => Err(format!("write `true`, or a list such as [\"nan\"], and not {other}")),
        }
    }
}

/// The value of an `override`: a number, `true` or `false`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged, expecting = "an override's value is a number, `true` or `false`, without quotes")]
pub(crate) enum OverrideValue {
    Number(f64),
    Switch(bool),
}

impl OverrideValue {
    pub(crate) fn number(self) -> f64 {
        match self {
            Self::Number(number) => number,
            Self::Switch(on) => f64::from(u8::from(on)),
        }
    }
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Direction {
    Increasing,
    Decreasing,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Integral {
    /// The region: `"sphere"`, `"hemisphere"` or `"projected_hemisphere"`. The last one weights each direction by its
    /// cosine.
    pub(crate) over: Region,
    /// The expected integral: one number for all components, or a list of numbers.
    #[serde(alias = "is")]
    pub(crate) equals: Option<Value>,
    /// The largest value that the integral may have.
    pub(crate) at_most: Option<Value>,
    /// The amount by which the computed integral may exceed `at_most`, because of rounding errors.
    pub(crate) slack: Option<f64>,
    /// The number of rings of directions in the quadrature.
    pub(crate) rings: Option<u16>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Region {
    Sphere,
    Hemisphere,
    ProjectedHemisphere,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Frame {
    /// The name of the frame and of its golden.
    pub(crate) name: String,
    /// The module of the frame's functions. The default is the file's own module.
    pub(crate) module: Option<String>,
    /// The vertex function. By default, one triangle covers the frame.
    vertex: Option<String>,
    /// The fragment function.
    fragment: Option<String>,
    /// Several draws, which run in this order. Replaces the keys `vertex` and `fragment`. The keys of a draw have
    /// their own table.
    #[serde(default)]
    draws: Vec<draws::Declared>,
    /// The number of samples of each pixel: 1 or 4.
    pub(crate) samples: Option<u32>,
    /// The frame's width and height in pixels: `[256, 256]`.
    pub(crate) size: Pair<u32>,
    /// The format of each location: `["float", "rgba8unorm-srgb", "r32uint"]`. The default is `"float"`.
    #[serde(default)]
    pub(crate) formats: Vec<String>,
    /// The location that Karat compares, counted from 0.
    pub(crate) target: Option<usize>,
    /// Compares depth in place of colours: `true`.
    #[serde(default)]
    pub(crate) depth: bool,
    /// Textures, samplers and buffers, each under its variable's name.
    #[serde(default)]
    pub(crate) with: BTreeMap<String, Value>,
    /// The values of `override`s, by their names or numbers.
    #[serde(default, rename = "override")]
    pub(crate) overrides: BTreeMap<String, OverrideValue>,
    /// The largest relative difference that a pixel may have: `1e-3`. Without this key, a larger difference than 1e-3
    /// still passes if HDR-FLIP sees almost no difference.
    pub(crate) tolerance: Option<Relative>,
    /// Paths on which the test must fail, each with the reason: `{ gl = "clamps faces" }`.
    #[serde(default)]
    pub(crate) fails_on: BTreeMap<String, String>,
    /// Paths that can't run the test, each with the reason. These paths must refuse the test.
    #[serde(default)]
    pub(crate) refused_on: BTreeMap<String, String>,
    /// The folder of the frame's golden, relative to the test file.
    pub(crate) golden: Option<PathBuf>,
    #[serde(skip)]
    pub(crate) folder: PathBuf,
    /// The positions of the frame's keys in the file.
    #[serde(skip)]
    pub(crate) keys: Keys,
}

/// The positions of a test's keys in the file. `Debug` doesn't print the positions: Karat compares the `Debug` texts of
/// tests to find changed tests, and a test that only moved in its file hasn't changed.
#[derive(Clone, Default)]
pub(crate) struct Keys(BTreeMap<String, Span>);

impl fmt::Debug for Keys {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Keys")
    }
}

impl Keys {
    pub(crate) fn exactly(&self, key: &str) -> Option<&Span> {
        self.0.get(key)
    }

    /// The position of a key. If the file doesn't contain the key, the position of the innermost table around the key:
    /// for `draws.1.blend`, the position of `draws.1`, or otherwise of `draws`.
    pub(crate) fn place_of(&self, key: &str) -> Option<&Span> {
        self.0.get(key).or_else(|| self.place_of(key.rsplit_once('.')?.0))
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Assertion {
    pub(crate) test: Declared,
    /// The function's path: `brdf::schlick`.
    pub(crate) function: String,
    pub(crate) what: What,
    /// The folder of the test file, to which the paths of tables and images are relative.
    pub(crate) folder: PathBuf,
    pub(crate) keys: Keys,
}

impl Frame {
    pub(crate) fn draws(&self) -> Result<Vec<draws::Declared>, String> {
        match (&self.vertex, &self.fragment, &*self.draws) {
            (vertex, Some(fragment), []) => {
                Ok(vec![draws::Declared::covering(vertex.clone(), fragment.clone())])
            }
            (_, None, []) => {
                Err("the frame draws nothing: name a `fragment` function, or write `draws`"
                    .to_owned())
            }
            (None, None, all) => Ok(all.to_vec()),
            _ => Err(
                "each entry of `draws` names its functions: remove the frame's `vertex` and `fragment`"
                    .to_owned(),
            ),
        }
    }

    pub(crate) fn meshes(&self) -> impl Iterator<Item = PathBuf> {
        self.draws.iter().filter_map(|draw| draw.mesh_file(&self.folder))
    }

    pub(crate) fn golden_file(&self) -> PathBuf {
        self.golden_folder().join(format!("{}.exr", self.name))
    }

    pub(crate) fn entries(&self) -> Vec<String> {
        let module = self.module.as_deref().filter(|module| !module.is_empty());
        let named = |name: String| match module {
            Some(module) if !name.contains("::") => format!("{module}::{name}"),
            _ => name,
        };
        let draws = self.draws().unwrap_or_default();
        draws
            .into_iter()
            .flat_map(|draw| [draw.vertex, draw.fragment])
            .flatten()
            .map(named)
            .collect()
    }

    /// The subject in the record of a frame whose test can't begin.
    pub(crate) fn subject(&self, location: Option<&str>) -> Subject {
        Subject::Frame {
            golden: self.name.clone(),
            folder: self.golden_folder().display().to_string(),
            location: location.unwrap_or_default().to_owned(),
        }
    }

    pub(crate) fn golden_folder(&self) -> PathBuf {
        self.folder.join(self.golden.as_deref().unwrap_or(Path::new(GOLDEN)))
    }
}

/// The name of the folder with goldens, which is beside the test file.
pub(crate) const GOLDEN: &str = "golden";

impl Assertion {
    /// The path of a function: a plain name belongs to the tested function's module.
    pub(crate) fn of_module(&self, name: &str) -> String {
        match (name.contains("::"), self.function.rsplit_once("::")) {
            (false, Some((module, _))) => format!("{module}::{name}"),
            _ => name.to_owned(),
        }
    }

    pub(crate) fn golden_file(&self) -> Option<PathBuf> {
        let What::Golden(name) = &self.what else { return None };
        Some(self.folder.join(GOLDEN).join(format!("{name}.csv")))
    }

    /// The position of `key`; if `key` is `None`, the position of the assertion.
    pub(crate) fn place_of(&self, key: Option<&str>) -> Option<&Span> {
        let named = key.and_then(|key| self.keys.place_of(key));
        named.or_else(|| self.keys.place_of(self.what.key()))
    }

    /// The test's tolerance. For integers and booleans, the default is `exact`. For floats, a missing tolerance is an
    /// error.
    pub(crate) fn tolerance(&self, result: &Shape) -> Result<&str, String> {
        let is_exact = result.lanes().iter().all(|lane| !lane.is_float());
        let exact = is_exact.then_some("exact");
        let takes_spec =
            matches!(self.what, What::AgreesWith(_) | What::Table(_) | What::Equals(_));
        let spec = if takes_spec { "; `spec` accepts every error that WGSL allows" } else { "" };
        let missing = || format!("a tolerance is missing, such as tolerance = \"4 ulp\"{spec}");
        self.test.tolerance.as_deref().or(exact).ok_or_else(missing)
    }
}

/// Replaces the list of known names in the parser's message by a suggestion: ``did you mean `finite`?``.
fn with_nearest(message: &str) -> String {
    let mut names = message.split('`').skip(1).step_by(2);
    let unknown = names.next().filter(|_| message.starts_with("unknown "));
    match unknown.and_then(|unknown| nearest(unknown, names)) {
        Some(_) if message.contains("did you mean") => message.to_owned(),
        // The suggestion replaces the list of all known names.
        Some(near) => {
            let unknown = message.split(", expected").next().unwrap_or(message);
            format!("{unknown}; did you mean `{near}`?")
        }
        None => message.to_owned(),
    }
}

/// Reads the tests in a TOML file, and returns an error for each wrong table. If `unsaved` is set, it is the text to
/// read instead of the file's content. `root` is the package's folder or file.
pub(crate) fn read(
    file: &Path,
    unsaved: Option<String>,
    root: &Path,
) -> Result<(Vec<Test>, Vec<Diagnostic>), Diagnostic> {
    let name = shown(file);
    let unread = |error: &dyn fmt::Display| of_whole(file, format!("can't read `{name}`: {error}"));
    let saved = || {
        let bytes = read_file(file).map_err(|error| unread(&error))?;
        String::from_utf8(bytes).map_err(|error| unread(&error))
    };
    let text = unsaved.map_or_else(saved, Ok)?;
    // Windows editors may write a byte order mark first.
    let text = text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text);
    let source = Arc::new(SourceFile::new(name, text));
    let at = |range: ops::Range<usize>| Span { file: Arc::clone(&source), range };
    let (mut text, mut wrong) = (source.text.clone(), Vec::new());
    let parsed: File = loop {
        let error = match toml::from_str(&text) {
            Ok(parsed) => break parsed,
            Err(error) => error,
        };
        let Some((table, range, message)) = at_fault(&text) else {
            let range = error.span().unwrap_or(0..0);
            return Err(Diagnostic::new(error.message()).at(at(range), ""));
        };
        let message = match &*message {
            "invalid type: map, expected a sequence" => {
                "a test begins with double brackets: [[test]], [[frame]] or [[compute]]".to_owned()
            }
            message => with_nearest(message),
        };
        wrong.push(Diagnostic::new(message).at(at(range), ""));
        // Replaces the table with the error by blanks, and reads the other tables.
        let blank = |c: char| if c == '\n' { "\n".to_owned() } else { " ".repeat(c.len_utf8()) };
        let blank: String = text[table.clone()].chars().map(blank).collect();
        text.replace_range(table, &blank);
    };
    if parsed.tests.is_empty()
        && parsed.frames.is_empty()
        && parsed.compute.is_empty()
        && wrong.is_empty()
    {
        let empty = "the file declares no test: write [[test]], [[frame]] or [[compute]]";
        return Err(Diagnostic::new(empty).at(at(0..0), ""));
    }
    let module = module_of(file, root);
    let folder = file.parent().unwrap_or(Path::new(".")).to_owned();
    let mut tests = Vec::new();
    let [mut keys, mut frame_keys, mut compute_keys] =
        TABLES.map(|kind| keys(&source, &text, kind).into_iter());
    for declared in parsed.tests {
        let keys = keys.next().unwrap_or_default();
        let span = at(declared.span());
        let declared = declared.into_inner();
        let function = match (&*module, declared.function.contains("::")) {
            ("", _) | (_, true) => declared.function.clone(),
            (module, false) => format!("{module}::{}", declared.function),
        };
        let what = match whats(&declared) {
            Ok(what) => what,
            Err(error) => {
                wrong.push(error.unread(&keys, &span));
                continue;
            }
        };
        if let Some((key, error)) = idle_key(&what, false, &|key| keys.0.contains_key(key)) {
            let place = keys.0.get(key).unwrap_or(&span).clone();
            wrong.push(Diagnostic::new(error).at(place, ""));
            continue;
        }
        for what in what {
            let name = match &declared.name {
                Some(name) => format!("{} {}", own(&module, name), what.name()),
                None => format!("{function} {}", what.name()),
            };
            let (test, function) = (declared.clone(), function.clone());
            let (folder, keys) = (folder.clone(), keys.clone());
            let assertion = Assertion { test, function, what, folder, keys };
            tests.push(Test {
                name,
                span: span.clone(),
                kind: Kind::Function(Box::new(assertion)),
            });
        }
    }
    let mut goldens: Vec<PathBuf> = Vec::new();
    for frame in parsed.frames {
        let span = at(frame.span());
        let mut frame = frame.into_inner();
        frame.module.get_or_insert_with(|| module.clone());
        frame.folder.clone_from(&folder);
        frame.keys = frame_keys.next().unwrap_or_default();
        if goldens.contains(&frame.golden_file()) {
            let twice = format!(
                "another frame has the name `{}`, so the two frames would use the same golden: rename one frame",
                frame.name
            );
            wrong.push(Diagnostic::new(twice).at(span, ""));
            continue;
        }
        goldens.push(frame.golden_file());
        let name = format!("frame {}", frame.name);
        tests.push(Test { name, span, kind: Kind::Frame(Box::new(frame)) });
    }
    for declared in parsed.compute {
        let span = at(declared.span());
        let keys = compute_keys.next().unwrap_or_default();
        let all = declared.into_inner().tests(&module, &folder, &keys);
        let all = all.map_err(|error| wrong.push(error.unread(&keys, &span)));
        for (name, assertion) in all.unwrap_or_default() {
            let is_same = |test: &Test| test.name == name && matches!(test.kind, Kind::Compute(_));
            if tests.iter().any(is_same) {
                let twice = format!(
                    "another `[[compute]]` also has a test `{name}`: add a `name` to one `[[compute]]`"
                );
                wrong.push(Diagnostic::new(twice).at(span.clone(), ""));
                continue;
            }
            let kind = Kind::Compute(Box::new(assertion));
            tests.push(Test { name, span: span.clone(), kind });
        }
    }
    Ok((tests, wrong))
}

const TABLES: [&str; 3] = ["test", "frame", "compute"];

/// The byte ranges of a file's tables, each with its subtables. The first range is the text before the first table.
fn blocks(text: &str) -> Vec<ops::Range<usize>> {
    // A subtable such as `[compute.after.keys]` doesn't begin a new test.
    let begins = |line: &str| {
        let inner = line.trim_start().strip_prefix('[').map(|line| line.trim_start_matches('['));
        let name = inner.map(|line| line.split([']', '#', '\n']).next().unwrap_or_default().trim());
        let is_word = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-');
        name.is_some_and(|name| name.starts_with(char::is_alphabetic) && name.chars().all(is_word))
    };
    let (mut start, mut heads) = (0, vec![0]);
    for line in text.split_inclusive('\n') {
        heads.extend(begins(line).then_some(start));
        start += line.len();
    }
    heads.push(text.len());
    heads.windows(2).map(|pair| pair[0]..pair[1]).filter(|one| !one.is_empty()).collect()
}

/// The first table with a parse error: the range of the table, the range of the error, and the message. The error of an
/// unclosed bracket is at the end of its table.
fn at_fault(text: &str) -> Option<(ops::Range<usize>, ops::Range<usize>, String)> {
    blocks(text).into_iter().find_map(|block| {
        let error = toml::from_str::<File>(&text[block.clone()]).err()?;
        let range = error.span().unwrap_or(0..0);
        let range = block.start + range.start..block.start + range.end;
        Some((block, range, error.message().to_owned()))
    })
}

/// The positions of the keys of each `[[test]]`, or of another kind of table.
fn keys(source: &Arc<SourceFile>, text: &str, kind: &str) -> Vec<Keys> {
    let Ok(table) = DeTable::parse(text) else { return Vec::new() };
    let table = table.into_inner();
    let Some(DeValue::Array(tests)) = table.get(kind).map(Spanned::get_ref) else {
        return Vec::new();
    };
    let keys = |test: &Spanned<DeValue<'_>>| {
        let mut keys = Keys::default();
        note_keys(source, "", test.get_ref(), &mut keys);
        keys
    };
    tests.iter().map(keys).collect()
}

/// Records the positions of all keys below a key. List elements have numbers as keys.
fn note_keys(source: &Arc<SourceFile>, above: &str, value: &DeValue<'_>, keys: &mut Keys) {
    let mut note = |name: &str, range, value: &Spanned<DeValue<'_>>| {
        let key = if above.is_empty() { name.to_owned() } else { format!("{above}.{name}") };
        note_keys(source, &key, value.get_ref(), keys);
        keys.0.insert(key, Span { file: Arc::clone(source), range });
    };
    match value {
        DeValue::Table(table) => {
            table.iter().for_each(|(key, value)| note(key.get_ref(), key.span(), value));
        }
        DeValue::Array(list) => {
            let all = list.iter().enumerate();
            all.for_each(|(at, value)| note(&at.to_string(), value.span(), value));
        }
        _ => {}
    }
}

fn own(module: &str, name: &str) -> String {
    if module.is_empty() { name.to_owned() } else { format!("{module}::{name}") }
}

/// The module beside a test file: `sub::brdf` for `sub/brdf.test.toml`; an empty name in a package of one file.
pub(crate) fn module_of(file: &Path, root: &Path) -> String {
    if root.is_file() {
        return String::new();
    }
    let below = file.strip_prefix(root).unwrap_or(file);
    let text = below.to_string_lossy();
    let stem = text.strip_suffix(".test.toml").unwrap_or(&text);
    stem.split(['/', '\\']).filter(|part| !part.is_empty()).collect::<Vec<_>>().join("::")
}

/// The assertions of a test; an error if the test has no assertion.
fn whats(test: &Declared) -> Result<Vec<What>, Misdeclared> {
    let shared = Shared {
        agrees_with: &test.agrees_with,
        table: &test.table,
        golden: &test.golden,
        equals: &test.equals,
        finite: test.finite,
        in_range: test.in_range,
    };
    let mut all = shared.whats()?;
    all.extend(switched("unit", test.unit, What::Unit)?);
    all.extend(switched("right_handed_frame", test.right_handed_frame, What::RightHandedFrame)?);
    all.extend(test.perpendicular_to.clone().map(What::PerpendicularTo));
    all.extend(test.no_hazards.clone().map(|NoHazards(kinds)| What::NoHazards(kinds)));
    all.extend(test.symmetric_in.clone().map(|names| What::SymmetricIn(names.0)));
    let monotone = test.monotone.iter().flatten();
    all.extend(monotone.map(|(name, direction)| What::Monotone(name.clone(), *direction)));
    let limit = test.limit.as_ref().map(limit).transpose();
    let limit = limit.map_err(Misdeclared::of("limit"))?;
    if let (Some(What::Limit { argument, .. }), true) = (&limit, all.is_empty())
        && test.over.contains_key(argument)
        && test.integral.is_none()
    {
        return Err(Misdeclared::of("over")(format!(
            "`{argument}` in `over` does nothing, because `limit` sets this argument: remove `{argument}`"
        )));
    }
    all.extend(limit);
    if let Some(integral) = &test.integral {
        match (&integral.equals, &integral.at_most) {
            (Some(_), None) if integral.slack.is_some() => {
                return Err(Misdeclared::of("integral.slack")(
                    "`slack` does nothing beside `equals`, which uses `tolerance`: remove `slack`"
                        .to_owned(),
                ));
            }
            (Some(_), None) | (None, Some(_)) => all.push(What::Integral(integral.clone())),
            _ => {
                let either = "an integral needs either `equals` or `at_most`".to_owned();
                return Err(Misdeclared::of("integral")(either));
            }
        }
    }
    if all.is_empty() {
        return Err(
            "this test asserts nothing: write agrees_with, table, golden, equals, finite, unit, \
                    perpendicular_to, right_handed_frame, in_range, symmetric_in, monotone, limit, \
                    integral or no_hazards"
                .into(),
        );
    }
    Ok(all)
}

/// Reads a limit: `{ alpha = 0, through = [0.1, 0.01], equals = 1 }`.
fn limit(table: &BTreeMap<String, Value>) -> Result<What, String> {
    // `is` is the old name of `equals`.
    const OWN: [&str; 3] = ["through", "equals", "is"];
    let form = "write a limit as { alpha = 0, through = [0.1, 0.01], equals = 1 }";
    let mut arguments = table.iter().filter(|(name, _)| !OWN.contains(&name.as_str()));
    let (Some((argument, toward)), None) = (arguments.next(), arguments.next()) else {
        let unknown = || table.keys().filter(|key| !OWN.contains(&key.as_str()));
        let near = unknown().find_map(|key| nearest(key, OWN)).filter(|_| table.len() == 3);
        let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
        return Err(format!("{form}{near}"));
    };
    let number = |value: &Value| match value {
        Value::Float(number) => Some(*number),
        #[expect(clippy::cast_precision_loss, reason = "numbers of shaders are small")]
        Value::Integer(number) => Some(*number as f64),
        _ => None,
    };
    let through = table.get("through").and_then(Value::as_array);
    let through: Option<Vec<f64>> = through.and_then(|list| list.iter().map(number).collect());
    match (number(toward), through, table.get("equals").or_else(|| table.get("is"))) {
        (Some(toward), Some(through), Some(is)) => {
            Ok(What::Limit { argument: argument.clone(), toward, through, is: is.clone() })
        }
        _ => Err(form.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Vec<String>, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("sub").join("brdf.test.toml");
        std::fs::create_dir(file.parent().expect("a parent")).expect("a folder");
        std::fs::write(&file, text).expect("a file");
        let (tests, wrong) = read(&file, None, folder.path()).map_err(|found| found.to_string())?;
        match wrong.first() {
            Some(found) => Err(found.to_string()),
            None => Ok(tests.into_iter().map(|test| test.name).collect()),
        }
    }

    /// A table with an unknown key, a wrong value or a TOML error doesn't hide the other tables.
    #[test]
    fn a_wrong_table_hides_no_other() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("m.test.toml");
        let good = |name: &str| format!("[[test]]\nfunction = \"{name}\"\nfinite = true\n");
        let read = |wrong: &str| {
            let text = format!("{}[[test]]\nfunction = \"b\"\n{wrong}\n{}", good("a"), good("c"));
            std::fs::write(&file, text).expect("a file");
            read(&file, None, folder.path()).map(|(tests, wrong)| {
                let place = |one: &Diagnostic| one.location().expect("a place").to_string();
                (tests.len(), wrong.iter().map(place).collect::<Vec<_>>())
            })
        };
        for (wrong, line) in [
            ("throughh = 3", 6),
            ("finite = 3", 6),
            ("finite = true\ntolerance = \"exact\"", 7),
            ("in_range = [0, 2", 6),
            ("name = \"n\"", 4),
            ("", 4),
        ] {
            let (tests, places) = read(wrong).expect("the file is read");
            assert_eq!((tests, places.len()), (2, 1), "{wrong}: {places:?}");
            assert!(places[0].contains(&format!("m.test.toml:{line}:")), "{wrong}: {places:?}");
        }
        // The file has text outside of tests, or a misspelled table header.
        for (first, line) in [
            ("[inputs]\nx = 1\n", 1),
            ("x = 1\n", 1),
            ("[[tests]]\nfunction = \"b\"\n", 1),
            ("[[test]\nfunction = \"b\"\n", 1),
            ("[test]\nfunction = \"b\"\nfinite = true\n", 1),
            ("[[test]]\nfunction = \"\"\"b\nfinite = true\n", 4),
        ] {
            let text = format!("\u{feff}{first}{}", good("a"));
            std::fs::write(&file, text).expect("a file");
            let (tests, wrong) = super::read(&file, None, folder.path()).expect("the file is read");
            let places: Vec<_> = wrong.iter().map(ToString::to_string).collect();
            let place = format!("m.test.toml:{line}:");
            assert!(tests.len() == 1 && places.len() == 1, "{first}: {places:?}");
            assert!(places[0].contains(&place), "{first}: {places:?}");
        }
    }

    #[test]
    fn each_assertion_is_a_test() {
        let names = read_text(
            "[[test]]\nfunction = \"f\"\nfinite = true\nin_range = [0, 1]\n\
             monotone = { x = \"increasing\" }\n[[test]]\nname = \"mine\"\nfunction = \"a::g\"\n\
             limit = { alpha = 0, through = [0.1, 0.01], equals = 1 }\n",
        );
        let names = names.expect("valid tests");
        assert_eq!(
            names,
            [
                "sub::brdf::f finite",
                "sub::brdf::f in_range",
                "sub::brdf::f monotone in x",
                "sub::brdf::mine limit of alpha"
            ]
        );
    }

    // Lesson 175
    #[test]
    fn a_test_without_an_assertion_is_an_error_at_its_place() {
        for (text, part) in [
            ("", "declares no test"),
            ("[[test]]\nfunction = \"f\"\n", "asserts nothing"),
            ("\n[[test]]\nfunction = \"f\"\nfinit = true\n", "brdf.test.toml:4:1"),
            ("[[test]]\nfunction = \"f\"\nfinite = false\n", "asserts nothing"),
            (
                "[[test]]\nfunction = \"f\"\nintegral = { over = \"sphere\" }\n",
                "either `equals` or",
            ),
            ("[[test]]\nfunction = \"f\"\nlimit = { alpha = 0 }\n", "write a limit as"),
            ("[[test]\n", "brdf.test.toml:1"),
            ("[[test]]\nfunction = \"f\"\nin_range = [0, 1, 2]\n", "the list must have two"),
            ("[[test]]\nfunction = \"f\"\nin_range = [0]\n", "but has 1"),
            ("[[test]]\nfunction = \"f\"\nno_hazards = false\n", "asserts nothing: remove the key"),
            ("[[test]]\nfunction = \"f\"\nno_hazards = [\"nam\"]\n", "did you mean `nan`?"),
            ("[[test]]\nfunction = \"f\"\nno_hazards = []\n", "asserts nothing: name kinds"),
            ("[compute]\nentry = \"f\"\n", "begins with double brackets"),
            ("[[test]]\nfunction = \"f\"\nno_hazards = \"nan\"\n", "or a list such as [\"nan\"]"),
            (
                "[[test]]\nfunction = \"f\"\nfinite = true\naccept_hazard = { \"1 / x\" = \"why\" }\n",
                "`accept_hazard` does nothing here",
            ),
            ("[[test]]\nfunction = \"f\"\nin_range = \"0...1\"\n", "write [0, 1], or \"0..<1\""),
            ("[[test]]\nfunction = \"f\"\nin_range = \"a..<1\"\n", "`a..<1` isn't a range"),
            ("[[test]]\nfunction = \"f\"\nin_range = [0, \"1\"]\n", "must be a number, but is"),
            (
                "[[test]]\nfunction = \"f\"\nin_range = [0, 1]\ntolerance = \"4 ulp\"\n",
                "brdf.test.toml:4:1",
            ),
            (
                "[[test]]\nfunction = \"f\"\nfinite = true\nno_hazards = true\n\
                 tolerance_on = { gl = \"4 ulp\" }\n",
                "`tolerance_on` does nothing here: `finite`, `no_hazards` can't have this key",
            ),
            (
                "[[test]]\nfunction = \"f\"\ntable = \"f.csv\"\ntolerance = \"4 ulp\"\n\
                 over = { x = \"0..1\" }\n",
                "brdf.test.toml:5:1",
            ),
            (
                "[[test]]\nfunction = \"f\"\ntable = \"f.csv\"\ntolerance = \"4 ulp\"\ncases = 9\n",
                "`cases` does nothing here: `table` can't have this key",
            ),
            (
                "[[test]]\nfunction = \"f\"\ntable = \"f.csv\"\ntolerance = \"4 ulp\"\nseed = 9\n",
                "brdf.test.toml:5:1",
            ),
            (
                "[[test]]\nfunction = \"f\"\ntolerance = \"4 ulp\"\n\
                 integral = { over = \"sphere\", at_most = 1, slack = 0 }\n",
                "`integral at_most` can't have this key",
            ),
            (
                "[[test]]\nfunction = \"f\"\ntolerance = \"4 ulp\"\n\
                 integral = { over = \"sphere\", equals = 1, slack = 0 }\n",
                "`slack` does nothing beside `equals`",
            ),
            (
                "[[test]]\nfunction = \"f\"\nover = { a = \"0..1\" }\n\
                 limit = { a = 0, through = [0.1, 0.01], equals = 1 }\ntolerance = \"4 ulp\"\n",
                "`a` in `over` does nothing",
            ),
            (
                "[[test]]\nfunction = \"f\"\nfinite = true\nwith = { d = 1, d = 2 }\n",
                "duplicate key",
            ),
            (
                "[[test]]\nfunction = \"f\"\nsymmetric_in = [\"a\", \"b\", \"c\"]\n",
                "test.toml:3:16",
            ),
            ("[[frame]]\nname = \"f\"\nfragment = \"f\"\nsize = [8, 8, 1]\n", "test.toml:4:8"),
            (
                "[[frame]]\nname = \"f\"\nfragment = \"f\"\nsize = [8, 8]\ntolerance = \"1 %\"\n",
                "or \"rel 1e-3\"",
            ),
        ] {
            let error = read_text(text).expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
