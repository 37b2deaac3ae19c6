//! Writes the values of frames as images: EXR files have the numbers, and PNG files have colours to look at. Also
//! writes a summary as text.

use std::error::Error;
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path as FilePath, PathBuf};

use karat::Image;
use karat::image::Precision;
use karat::unstable::diagnostic::shown;
use karat::unstable::frame::Tapped;
use karat::unstable::image::{write_colours, write_whole};
use karat::unstable::metric::ErrorMap;
use karat::unstable::output::{Style, counted};
use karat::unstable::value::{Scalar, Shape, format_f32, format_lane};

/// The colour of NaN and infinities. Previews of frames have the same colour.
const NAN: [u8; 4] = [255, 0, 255, 255];
const INFINITE: [u8; 4] = [255, 255, 0, 255];

/// The largest deviation of a direction's squared length from 1. `normalize` may have an error of some steps of `f32`,
/// and `f16` has only three decimal digits.
const UNIT: f64 = 4e-3;

/// The mapping from numbers to colours.
enum Mapping {
    /// Booleans: black means false, white means true.
    Truth,
    /// One number. The colour scale magma goes from the smallest to the largest value.
    Range([f64; 2]),
    /// One number, with values below and above 0. Negative values are blue, 0 is black, and positive values are red.
    /// The largest absolute value has the brightest colour.
    Signed(f64),
    /// Three numbers that form a unit vector. Red, green and blue are half of 1 + x, 1 + y and 1 + z.
    Direction,
    /// Two to four numbers as red, green and blue: a channel is 0 for the smallest of all numbers, and 1 for the
    /// largest.
    Channels([f64; 2]),
}

/// Writes the images of a value into a folder, as `<frame>.<value>.exr` and `.png`, and describes the images.
///
/// # Errors
/// Returns an error if a file can't be written.
pub(crate) fn write_tapped(
    folder: &FilePath,
    frame: &str,
    tapped: &Tapped,
    out: &mut dyn Write,
) -> Result<(), Box<dyn Error>> {
    let head = Style::HEAD;
    let scalars = tapped.shape.lanes();
    let text = tapped.text.split_whitespace().collect::<Vec<_>>().join(" ");
    let title = tapped.name.as_deref().unwrap_or(&text);
    let (line, column) = tapped.span.file.line_column(tapped.span.range.start);
    let place = format!("{}:{line}:{column}", tapped.span.file.name);
    let of = &tapped.function;
    writeln!(out, "{head}{title}{head:#}  {place} in `{of}`: {}", tapped.shape)?;
    for (lane, name) in tapped.shape.lane_names().iter().enumerate() {
        writeln!(out, "    {}", summary(tapped, &scalars, lane, name))?;
    }
    for note in notes(tapped) {
        writeln!(out, "    {note}")?;
    }
    if tapped.told.iter().all(|told| !told) {
        writeln!(out, "    no {} computes the value, so Karat writes no image", tapped.of)?;
        return Ok(());
    }
    if let Some(part) = part_of(&tapped.shape) {
        let one = format!("{title}{part}");
        writeln!(
            out,
            "    Karat can't write this value as an image: name a component, member or element, such as `{one}`"
        )?;
        return Ok(());
    }
    let mut named = tapped.name.as_ref().map(|name| format!("{of}::{name}"));
    if let (Some(name), true) = (&mut named, tapped.has_twin) {
        let _ = write!(name, "-{line}");
    }
    let named = named.map(|name| match tapped.round {
        Some(round) => format!("{name}-round-{round}"),
        None => name,
    });
    let stem = folder.join(format!("{frame}.{}", file_name(named.as_deref().unwrap_or(&text))));
    if tapped.size.1 == 1 && tapped.of != "pixel" {
        let csv = with_ending(&stem, "csv");
        write_whole(&csv, table(tapped, scalars.len()).as_bytes())?;
        writeln!(out, "    {} has a row for each {}", shown(&csv), tapped.of)?;
        return Ok(());
    }
    let [exr, png] = ["exr", "png"].map(|ending| with_ending(&stem, ending));
    image(tapped, &scalars).write_exr(&exr, Precision::Float, None)?;
    let mapping = mapping(tapped, &scalars);
    write_colours(&png, tapped.size, &colours(tapped, &scalars, &mapping))?;
    let strange = numbers(tapped, &scalars).flatten().any(|x| !x.is_finite());
    let strange = if strange { "; NaN is magenta, and infinities are yellow" } else { "" };
    let rounds =
        numbers(tapped, &scalars).flatten().any(|x| x.is_finite() && x != f64::from(to_f32(x)));
    let rounds = if rounds { "; the EXR file rounds integers beyond 2^24" } else { "" };
    writeln!(out, "    {}  {}: {}{strange}{rounds}", shown(&exr), shown(&png), mapping.told())?;
    Ok(())
}

/// Returns the path of the first member or element, such as `.colour` or `[0]`. `None` for a scalar or a vector, which
/// Karat can draw as an image.
fn part_of(shape: &Shape) -> Option<String> {
    match shape {
        Shape::Scalar(_) | Shape::Vector { .. } => None,
        Shape::Matrix { .. } | Shape::Array { .. } => Some("[0]".to_owned()),
        Shape::Struct { members, .. } => {
            Some(members.first().map_or_else(String::new, |(name, _)| format!(".{name}")))
        }
    }
}

fn with_ending(stem: &FilePath, ending: &str) -> PathBuf {
    let mut name = stem.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    name.into()
}

/// Formats a number with six significant digits.
fn digits(x: f64) -> String {
    let rounded: f64 = format!("{x:.5e}").parse().unwrap_or(x);
    format_f32(to_f32(rounded))
}

#[expect(clippy::cast_possible_truncation, reason = "images and their descriptions use f32")]
fn to_f32(x: f64) -> f32 {
    x as f32
}

/// Returns a name for files, of letters and digits.
fn file_name(title: &str) -> String {
    /// The largest number of characters in a name.
    const MOST: usize = 48;
    let mut name = String::new();
    for c in title.chars().take(MOST) {
        match c.is_ascii_alphanumeric() || c == '_' {
            true => name.push(c),
            false if name.ends_with('-') => {}
            false => name.push('-'),
        }
    }
    name.trim_matches('-').to_owned()
}

/// Returns the values as a table, or an empty text if they don't fit into a table.
fn table(tapped: &Tapped, width: usize) -> String {
    let mut text = String::from("invocation,times");
    let names = tapped.shape.lane_names();
    let named =
        |name: &String| if name.is_empty() { ",value".to_owned() } else { format!(",{name}") };
    text.extend(names.iter().map(named));
    let scalars = tapped.shape.lanes();
    let rows = tapped.lanes.chunks_exact(width).zip(&tapped.told).zip(&tapped.times);
    for (index, ((lanes, told), times)) in rows.enumerate() {
        let _ = write!(text, "\n{index},{}", times.unwrap_or(0));
        for (lane, scalar) in lanes.iter().zip(&scalars) {
            text.push(',');
            if *told {
                text += &format_lane(*scalar, *lane);
            }
        }
    }
    text.push('\n');
    text
}

/// Returns the values of one component (`lane`) with their pixels.
fn lane_of(tapped: &Tapped, width: usize, lane: usize) -> impl Iterator<Item = (usize, u32)> {
    let rows = tapped.lanes.chunks_exact(width).zip(&tapped.told).enumerate();
    rows.filter(|(_, (_, told))| **told).map(move |(pixel, (lanes, _))| (pixel, lanes[lane]))
}

/// Formats the smallest and the largest value of one component (`lane`) with their pixels, the mean, and the number of
/// values that aren't finite.
fn summary(tapped: &Tapped, scalars: &[Scalar], lane: usize, name: &str) -> String {
    let scalar = scalars[lane];
    let of_lane = || lane_of(tapped, scalars.len(), lane);
    let at = |pixel: usize| {
        let width = tapped.size.0 as usize;
        format!("({}, {})", pixel % width, pixel / width)
    };
    let mut text = if name.is_empty() { String::new() } else { format!("{name}: ") };
    let finite = || of_lane().filter(|(_, word)| scalar.decode(*word).is_finite());
    // Of equal values, the text names the first pixel.
    let by = |a: &(usize, u32), b: &(usize, u32)| scalar.decode(a.1).total_cmp(&scalar.decode(b.1));
    match (finite().min_by(by), finite().max_by(|a, b| by(a, b).then(b.0.cmp(&a.0)))) {
        (Some(least), Some(most)) => {
            let shown = |(pixel, word): (usize, u32)| {
                format!("{} at {}", format_lane(scalar, word), at(pixel))
            };
            // Each sum has as many terms as an image has pixels. So the sum in `f64` keeps 9 digits.
            #[expect(
                clippy::cast_precision_loss,
                reason = "an image has far fewer pixels than 2^53"
            )]
            let mean = finite().map(|(_, word)| scalar.decode(word)).sum::<f64>()
                / finite().count() as f64;
            let _ = write!(text, "from {} to {}, mean {}", shown(least), shown(most), digits(mean));
        }
        _ => text += "no value is finite",
    }
    let mut strange = |what: &str, is: fn(f64) -> bool| {
        let mut all = of_lane().filter(|(_, word)| is(scalar.decode(*word))).peekable();
        if let Some((first, _)) = all.peek().copied() {
            let _ = write!(
                text,
                "; {what} on {}, first at {}",
                counted(all.count(), tapped.of),
                at(first)
            );
        }
    };
    strange("NaN", f64::is_nan);
    strange("infinite", f64::is_infinite);
    text
}

/// Returns notes for the user: how many pixels compute the value, how often they compute it, and how many pixels change
/// their colour in the modified shader that Karat runs to read the value.
fn notes(tapped: &Tapped) -> Vec<String> {
    let all = tapped.told.len();
    let undrawn = tapped.times.iter().filter(|times| times.is_none()).count();
    let told = tapped.told.iter().filter(|told| **told).count();
    let mut notes = Vec::new();
    if told < all {
        let mut parts = vec![format!("{told} of {} compute the value", counted(all, tapped.of))];
        if undrawn > 0 {
            parts.push(format!("{undrawn} aren't drawn or are discarded"));
        }
        if all - told - undrawn > 0 {
            parts.push(format!("{} don't reach the code of the value", all - told - undrawn));
        }
        notes.push(parts.join(", "));
    }
    let most = tapped.times.iter().flatten().max().copied().unwrap_or(0);
    if let Some(round) = tapped.round {
        notes.push(format!(
            "the value is computed up to {most} times: the numbers above are from computation {round}"
        ));
    } else if most > 1 {
        notes.push(format!(
            "the value is computed up to {most} times: the numbers above are from the last computation, and --round selects another computation"
        ));
    }
    match tapped.changed {
        None => {}
        Some(0) => notes.push("the frame's colours don't change when Karat reads the value".to_owned()),
        Some(pixels) => notes.push(format!(
            "to read the value, Karat changes the shader, and the changed shader gives {} of the frame another colour",
            counted(pixels, "pixel")
        )),
    }
    notes
}

/// Returns the numbers as an image. Pixels without a value are transparent.
fn image(tapped: &Tapped, scalars: &[Scalar]) -> Image {
    let rows = tapped.lanes.chunks_exact(scalars.len()).zip(&tapped.told);
    let pixel = |(lanes, told): (&[u32], &bool)| {
        let mut pixel = [0.0, 0.0, 0.0, if *told { 1.0 } else { 0.0 }];
        for ((channel, lane), scalar) in pixel.iter_mut().zip(lanes).zip(scalars) {
            *channel = to_f32(scalar.decode(*lane));
        }
        if let ([_], true) = (lanes, told) {
            pixel = [pixel[0], pixel[0], pixel[0], 1.0];
        }
        pixel
    };
    Image::new(tapped.size.0, tapped.size.1, rows.map(pixel).collect())
}

/// Returns the numbers of each pixel with a value.
fn numbers<'t>(tapped: &'t Tapped, scalars: &'t [Scalar]) -> impl Iterator<Item = Vec<f64>> + 't {
    let rows = tapped.lanes.chunks_exact(scalars.len()).zip(&tapped.told);
    let told = rows.filter(|(_, told)| **told);
    told.map(move |(lanes, _)| {
        lanes.iter().zip(scalars).map(|(lane, scalar)| scalar.decode(*lane)).collect()
    })
}

fn mapping(tapped: &Tapped, scalars: &[Scalar]) -> Mapping {
    if scalars.iter().all(|scalar| *scalar == Scalar::Bool) {
        return Mapping::Truth;
    }
    let finite = numbers(tapped, scalars).flatten().filter(|x| x.is_finite());
    let [least, most] = finite
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], x| [least.min(x), most.max(x)]);
    let range = if least <= most { [least, most] } else { [0.0, 1.0] };
    let is_unit =
        |numbers: Vec<f64>| (numbers.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() <= UNIT;
    match scalars {
        [_] if least < 0.0 && most > 0.0 => Mapping::Signed(most.max(-least)),
        [_] => Mapping::Range(range),
        [_, _, _] if numbers(tapped, scalars).all(is_unit) => Mapping::Direction,
        _ => Mapping::Channels(range),
    }
}

impl Mapping {
    /// Describes the mapping.
    fn told(&self) -> String {
        match self {
            Self::Truth => "white is true".to_owned(),
            Self::Range([same, other]) if same == other => {
                format!("all values are {}", digits(*same))
            }
            Self::Range([least, most]) => {
                format!(
                    "black is {}, light yellow is {} (colour map magma)",
                    digits(*least),
                    digits(*most)
                )
            }
            Self::Signed(most) => format!("black is 0, red is {0}, blue is -{0}", digits(*most)),
            Self::Direction => {
                "the value is a direction: red, green and blue are half of 1 + x, 1 + y and 1 + z"
                    .to_owned()
            }
            Self::Channels([least, most]) => {
                let [least, most] = [least, most].map(|end| digits(*end));
                format!("red, green and blue are the value's numbers, from {least} to {most}")
            }
        }
    }

    fn colour(&self, numbers: &[f64]) -> [u8; 4] {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        let byte = |x: f64| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
        let share = |x: f64, [least, most]: [f64; 2]| {
            if most > least { (x - least) / (most - least) } else { 0.0 }
        };
        match self {
            _ if numbers.iter().any(|x| x.is_nan()) => NAN,
            _ if numbers.iter().any(|x| x.is_infinite()) => INFINITE,
            Self::Truth => {
                let [r, g, b] = [0, 1, 2].map(|at| byte(*numbers.get(at).unwrap_or(&numbers[0])));
                [r, g, b, 255]
            }
            Self::Range(range) => {
                let [r, g, b] = ErrorMap::colour(to_f32(share(numbers[0], *range)));
                [r, g, b, 255]
            }
            Self::Signed(most) => {
                let x = numbers[0] / most;
                [byte(x), 0, byte(-x), 255]
            }
            Self::Direction => {
                let [r, g, b] = [0, 1, 2].map(|at| byte(0.5 + 0.5 * numbers[at]));
                [r, g, b, 255]
            }
            Self::Channels(range) => {
                let of = |at: usize| numbers.get(at).map_or(0, |x| byte(share(*x, *range)));
                [of(0), of(1), of(2), 255]
            }
        }
    }
}

fn colours(tapped: &Tapped, scalars: &[Scalar], mapping: &Mapping) -> Vec<u8> {
    let mut numbers = numbers(tapped, scalars);
    let mut colour = |told: &bool| match told {
        true => numbers.next().map_or([0; 4], |numbers| mapping.colour(&numbers)),
        false => [0; 4],
    };
    tapped.told.iter().flat_map(&mut colour).collect()
}
