//! Makes a pass from a fragment function that writes storage. Each invocation is a pixel, and the pixels run in no
//! fixed order.

use std::sync::Arc;

use karat::fixture::{Fixture, Storage, Uniform};
use karat::package::Package;
use karat::unstable::dispatch::Passes;
use karat::unstable::fixture;
use karat::unstable::probe::Probed;

use crate::made_up::{Arguments, Content, Extents, Mix, Ranges, Resources};

/// The widths and heights of draws in pixels, used in turn. Each draw has about as many pixels as the usual dispatch of
/// a compute pass has invocations, if the workgroup size is 8 x 8. Width and height differ. An edge at any tenth,
/// quarter or third of the draw splits a quad in at least one of these sizes.
const SIZES: [[u32; 2]; 4] = [[18, 26], [14, 22], [22, 30], [10, 34]];

/// The seed of the inputs. Functions with the same signature get the same inputs on every machine.
const SEED: u64 = 0x7069_7865_6c73; // "pixels"

/// Makes a pass whose invocations are the pixels of a draw, or a single pixel. Inputs and resources are generated; the
/// resources' sizes follow from the number of pixels.
///
/// # Errors
/// Returns an error if the function isn't valid, or if an input or a resource can't be generated.
pub(crate) fn of_pixels(
    package: &Package,
    name: &str,
    single: bool,
    ranges: &Ranges,
    (content, mix): (Content, Option<&Mix<'_>>),
) -> Result<(Passes, Resources), String> {
    let ranges = &ranges.scoped(name);
    let overrides = ranges.overrides_of(package, name);
    let probed = Probed::with_overrides(package, name, &overrides);
    let probed = probed.map_err(|error| error.to_string())?;
    let (program, function) = (&probed.program, probed.function());
    // A single pixel needs the other pixels of its quad.
    let whole = SIZES[content.draw % SIZES.len()];
    let (size, [across, down]) = if single { ([1; 2], [2; 2]) } else { (whole, whole) };
    let extents_of = |content| Extents::of([1; 3], [whole[0], whole[1], 1], content);
    let extents = extents_of(content);
    let mix = mix.map(|mix| Mix { extents: Some(extents_of(mix.content)), ..*mix });
    let of = (&**program, &*function.bindings);
    let made = Resources::of_pass(of, ranges, extents, mix.as_ref())?;
    let arguments = Arguments::of_draw(function, ranges, extents)?;
    let (count, rows) = arguments.rows(SEED, Content::OF_PASSES.len());
    let width = arguments.width();
    let row = |number: usize| {
        rows.chunks_exact(width.max(1)).nth(number % count.max(1)).unwrap_or_default()
    };
    let words =
        arguments.of_pixels(function, [content.draw, content.draw + 1].map(row), [across, down]);
    let kernel = probed.kernel.of_pixels();
    let text = kernel.text.strip_prefix(program.text()).expect("a kernel begins with the program");
    let drawn = program.followed_by(text).map_err(|error| error.to_string())?;
    let bindings = drawn.fragment_entry_point(Probed::ENTRY_POINT).expect("an entry point");
    let (_, words_out) = kernel.words();
    let results = vec![0_u32; (words_out + 1) * (across * down) as usize];
    let own: [(u32, Fixture); 3] = [
        (0, Storage::new(words).into()),
        (1, Storage::new(results).into()),
        (2, Uniform::new(glam::UVec4::new(1, 0, across, 0)).into()),
    ];
    let first = kernel.first_binding();
    let given = fixture::resolve(&function.bindings, &made.fixtures);
    let given = given.map_err(|error| error.to_string())?;
    let fixture_of = |place: (u32, u32)| {
        let mut given = given.iter().map(|(one, fixture)| ((one.group, one.binding), *fixture));
        let mut own = own.iter().map(|(number, fixture)| ((0, first + number), fixture));
        let found = given.find(|(at, _)| *at == place).or_else(|| own.find(|(at, _)| *at == place));
        found.expect("a kernel uses what its function does").1.clone()
    };
    let bound = bindings.into_iter().map(|one| {
        let fixture = fixture_of((one.group, one.binding));
        (one, fixture)
    });
    let bound: Vec<_> = bound.collect();
    let size = [size[0], size[1], 1];
    let mut passes = Passes::over(Arc::new(drawn), Probed::ENTRY_POINT, size, &bound);
    let pass = &mut passes.passes[0];
    let outputs = function.outputs();
    let scalars = outputs.iter().flat_map(|(_, shape)| shape.lanes()).collect();
    (pass.name, pass.drawn) = (name.to_owned(), Some(scalars));
    Ok((passes, made))
}
