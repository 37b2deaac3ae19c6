//! Replies to the page's questions about pixels of frames.

use std::fmt::Debug;
use std::sync::{Arc, Mutex};

use karat::Image;
use serde_json::{Value, json};

use super::{Case, Entry, Map, golden_name, packed};

/// A source of values and traces of pixels. The program that serves the page implements this trait.
pub trait Pixels: Debug + Send + Sync {
    /// Lists the shader values that [`tap`](Self::tap) can show for a frame. Each element is one value, such as
    /// `scene::shade::n: vec3<f32> = normalize(v)`.
    ///
    /// # Errors
    /// Returns an error if the frame is unknown, or can't be drawn.
    fn values(&self, frame: &str) -> Result<Vec<String>, String>;

    /// Returns a map of this size, with the value at each pixel of the frame.
    ///
    /// # Errors
    /// Returns an error if the value can't be computed.
    fn tap(&self, frame: &str, size: (u32, u32), value: &str) -> Result<Map, String>;

    /// Returns the steps that compute a pixel, as `karat trace --json` prints them. `size` is the size of the frame.
    /// With a commit, returns two traces: one with the shaders of that commit, and one with the current shaders.
    ///
    /// # Errors
    /// Returns an error if the pixel can't be traced.
    fn trace(
        &self,
        frame: &str,
        size: (u32, u32),
        pixel: (u32, u32),
        commit: Option<&str>,
    ) -> Result<Value, String>;
}

/// The pixel source of a review, if the serving program has one.
#[derive(Clone, Debug, Default)]
pub(super) struct Asked {
    pub(super) pixels: Option<Arc<dyn Pixels>>,
    /// The lock that allows one question at a time: each question draws a frame.
    busy: Arc<Mutex<()>>,
}

impl Asked {
    pub(super) fn of(pixels: Arc<dyn Pixels>) -> Self {
        Self { pixels: Some(pixels), busy: Arc::default() }
    }

    /// Replies to `values`, to `tap/640x360/scene::shade::n`, or to `trace/640x360/12,34`. A `trace` question may end
    /// in `/<commit>`. Returns `None` for other questions.
    pub(super) fn answer(&self, entry: &Entry, question: &str) -> Option<Value> {
        let pixels = self.pixels.as_ref()?;
        let frame = match entry {
            Entry::Pending(name) => name.as_str(),
            // The name of a profile's golden is after its folder.
            Entry::Golden(file) => match golden_name(file).0 {
                name if name.starts_with('@') => name.split_once('/').map_or(name, |(_, own)| own),
                name => name,
            },
            Entry::Failure(_) => return None,
        };
        let _turn = self.busy.lock();
        let mut parts = question.splitn(3, '/');
        let (kind, size, what) = (parts.next()?, parts.next(), parts.next());
        let told = match (kind, size.and_then(|size| numbers(size, 'x')), what) {
            ("values", None, None) => pixels.values(frame).map(|values| json!({ "values": values })),
            ("tap", Some(size), Some(value)) if is_path(value) => {
                pixels.tap(frame, size, value).map(|map| {
                    let Map { name, about, image, range } = map;
                    let image = packed::map(&image);
                    json!({ "map": { "name": name, "about": about, "range": range, "image": image } })
                })
            }
            ("trace", Some(size), Some(what)) => {
                let (pixel, commit) = match what.split_once('/') {
                    Some((pixel, commit)) if is_commit(commit) => (pixel, Some(commit)),
                    Some(_) => return None,
                    None => (what, None),
                };
                let pixel = numbers(pixel, ',')?;
                pixels.trace(frame, size, pixel, commit).map(|pixel| json!({ "pixel": pixel }))
            }
            _ => return None,
        };
        Some(told.unwrap_or_else(|error| json!({ "error": error })))
    }
}

/// The number of traced pixels in a page without a server. Each trace takes about a second.
const IN_ADVANCE: usize = 3;

impl Asked {
    /// Returns the traces of the pixels that differ most from the golden. If possible, also traces these pixels with
    /// the shaders of the commit that last changed the golden, the first in `versions`. Returns null if no pixel can be
    /// traced.
    pub(super) fn in_advance(&self, case: &Case, versions: &[Value]) -> Value {
        let mut all = serde_json::Map::new();
        let pair =
            case.parts.first().and_then(|part| part.golden.as_ref().zip(part.actual.as_ref()));
        let (Some(pixels), Some((golden, actual))) = (&self.pixels, pair) else {
            return Value::Null;
        };
        let size = (actual.width(), actual.height());
        let commit = versions.first().and_then(|version| version["commit"].as_str());
        for (x, y) in farthest(golden, actual) {
            let trace = |commit: Option<&str>| pixels.trace(&case.name, size, (x, y), commit);
            let both = commit.and_then(|commit| Some((trace(Some(commit)).ok()?, commit)));
            let told = match both {
                Some((pair, commit)) => json!([pair[0], pair[1], commit]),
                None => match trace(None) {
                    Ok(pixel) => json!([null, pixel, null]),
                    // The next pixel would fail for the same reason.
                    Err(_) => break,
                },
            };
            all.insert(format!("{x},{y}"), told);
        }
        if all.is_empty() { Value::Null } else { Value::Object(all) }
    }
}

/// Returns the pixels whose values differ most, for images of the same size. NaN and infinities come first.
fn farthest(golden: &Image, actual: &Image) -> Vec<(u32, u32)> {
    let width = actual.width();
    if (golden.width(), golden.height()) != (width, actual.height()) {
        return Vec::new();
    }
    let far = |(a, b): (&[f32; 4], &[f32; 4])| {
        let of = |(a, b): (&f32, &f32)| match (a.is_finite(), b.is_finite()) {
            (true, true) => (a - b).abs(),
            _ if a.to_bits() == b.to_bits() => 0.0,
            _ => f32::INFINITY,
        };
        a.iter().zip(b).map(of).fold(0.0, f32::max)
    };
    let all = golden.pixels().iter().zip(actual.pixels()).map(far).enumerate();
    let mut all: Vec<(usize, f32)> = all.filter(|(_, far)| *far > 0.0).collect();
    all.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    let place = |(at, _): &(usize, f32)| (*at as u32 % width, *at as u32 / width);
    all.iter().take(IN_ADVANCE).map(place).collect()
}

fn numbers(text: &str, between: char) -> Option<(u32, u32)> {
    let (a, b) = text.split_once(between)?;
    Some((a.parse().ok()?, b.parse().ok()?))
}

/// Checks if a text is a WGSL name with its path, such as `scene::shade::n`. Such a text contains no `-`, so no program
/// takes the text for an option.
fn is_path(value: &str) -> bool {
    let is_name = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    !value.is_empty() && value.chars().all(is_name)
}

/// Checks if a text looks like the hash of a git commit. Such a text contains no `-`, so git doesn't take the text for
/// an option.
fn is_commit(text: &str) -> bool {
    (4..=64).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}

#[cfg(test)]
mod tests {
    use super::*;
    use karat::Image;

    #[derive(Debug)]
    struct Echo;

    impl Pixels for Echo {
        fn values(&self, frame: &str) -> Result<Vec<String>, String> {
            Ok(vec![frame.to_owned()])
        }

        fn tap(&self, _: &str, _: (u32, u32), value: &str) -> Result<Map, String> {
            let image = Image::new(1, 1, vec![[0.5, 0.5, 0.5, 1.0]]);
            Ok(Map { name: value.to_owned(), about: String::new(), image, range: [0.0, 1.0] })
        }

        fn trace(
            &self,
            frame: &str,
            size: (u32, u32),
            pixel: (u32, u32),
            commit: Option<&str>,
        ) -> Result<Value, String> {
            Err(format!("{frame} {size:?} {pixel:?} {commit:?}"))
        }
    }

    #[test]
    fn the_farthest_pixels_come_first() {
        let golden = Image::new(3, 2, vec![[0.0; 4]; 6]);
        let mut actual = golden.clone();
        let pixels = actual.pixels_mut();
        (pixels[1][0], pixels[2][3], pixels[4][1], pixels[5][0]) = (0.5, f32::NAN, -2.0, 0.25);
        assert_eq!(farthest(&golden, &actual), [(2, 0), (1, 1), (1, 0)]);
        assert_eq!(farthest(&golden, &golden), []);
        assert_eq!(farthest(&golden, &Image::new(2, 3, vec![[1.0; 4]; 6])), []);
    }

    // Lesson 39
    #[test]
    fn questions_are_read_and_nothing_else() {
        let asked = Asked::of(Arc::new(Echo));
        let entry = Entry::Golden("@gl-llvmpipe/scene.exr".to_owned());
        let answer = |question: &str| asked.answer(&entry, question);
        assert_eq!(answer("values"), Some(json!({ "values": ["scene"] })));
        assert_eq!(answer("trace/4x2/3,1"), Some(json!({ "error": "scene (4, 2) (3, 1) None" })));
        let with = json!({ "error": "scene (4, 2) (3, 1) Some(\"1a2b\")" });
        assert_eq!(answer("trace/4x2/3,1/1a2b"), Some(with));
        assert_eq!(answer("tap/4x2/m::n").expect("a map")["map"]["name"], "m::n");
        for wrong in [
            "",
            "value",
            "tap/4x2/--out",
            "tap/4x2/a b",
            "tap/4x2/",
            "tap/4/n",
            "trace/4x2/3",
            "trace/4x2/-1,0",
            "trace/4x2/3,1/HEAD",
            "trace/4x2/3,1/--json",
            "values/4x2",
        ] {
            assert_eq!(answer(wrong), None, "{wrong}");
        }
        assert_eq!(asked.answer(&Entry::Failure(0), "values"), None);
        assert_eq!(Asked::default().answer(&entry, "values"), None);
    }
}
