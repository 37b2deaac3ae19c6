//! A first `[[compute]]` test of a compute entry point. The sizes of the pass's resources follow from the dispatch.

use karat::Package;
use karat::unstable::package::FunctionItem;
use karat::unstable::reflect::{BindingKind, Dimension, Program, Stage, Texels, TextureKind};
use karat::unstable::value::{Scalar, Shape};
use karat_inspect::Usual;

/// The smallest number of elements that the test gives to a runtime-sized array.
const LEAST: u32 = 64;

/// The largest length of an array that a test lists element by element.
const SPELLED: u32 = 16;

/// Returns a test of a pass. Returns `None` if the size of a resource doesn't follow from the dispatch, or if the pass
/// writes no resource.
pub(super) fn declaration(package: &Package, item: &FunctionItem) -> Option<String> {
    let (module, name) = item.name.rsplit_once("::").unwrap_or(("", &item.name));
    let program = Program::of_items(package, module, &[name]).ok()?;
    let usual = Usual::of(package, &item.name).ok()?;
    let groups = usual.workgroups();
    let bindings = program.entry_point_bindings(Stage::Compute, name)?;
    let entry = program
        .module()
        .entry_points
        .iter()
        .find(|entry| entry.name == program.entry_point_name(name))?;
    if entry.workgroup_size_overrides.is_some() {
        return None;
    }
    let size = entry.workgroup_size;
    let invocations: u32 = size.iter().chain(&groups).product();
    let elements = invocations.max(LEAST);
    let numbers = (&usual, elements);
    let (mut with, mut written) = (Vec::new(), Vec::new());
    for binding in &bindings {
        let [width, height] = [0, 1].map(|k| size[k] * groups[k]);
        match binding.kind {
            BindingKind::StorageTexture { dimension: Dimension::D2, arrayed: false, .. } => {
                with.push(format!("{} = {{ size = [{width}, {height}] }}", binding.name()));
                if program.writes(name, binding) {
                    written.push(binding.name().to_owned());
                }
                continue;
            }
            BindingKind::Texture(kind) => {
                with.push(format!("{} = {}", binding.name(), drawn(kind, [width, height])?));
                continue;
            }
            BindingKind::Sampler { comparison } => {
                let sampler = if comparison { "linear less_equal" } else { "linear" };
                with.push(format!("{} = \"{sampler}\"", binding.name()));
                continue;
            }
            BindingKind::Uniform | BindingKind::Storage { .. } => {}
            _ => return None,
        }
        let shape = program.buffer_of(binding, elements as usize)?;
        let grows = program.buffer_of(binding, elements as usize + 1)? != shape;
        let value = match &shape {
            Shape::Array { element, .. } if grows => array(element, Some(elements)),
            _ if grows => return None,
            // The array is too long to list.
            Shape::Array { element, length } if *length > SPELLED => array(element, None),
            _ => value(&shape, binding.name(), numbers)?,
        };
        with.push(format!("{} = {value}", binding.name()));
        if program.writes(name, binding) {
            written.push(binding.name().to_owned());
        }
    }
    let [x, y, z] = groups;
    let first = written.first()?;
    Some(format!(
        "[[compute]]\nentry = \"{name}\"\nworkgroups = [{x}, {y}, {z}]\n# The resources before the pass: values, \
         files, or a number of elements from a range.\nwith = {{ {} }}\n# The pass has no race, no missed barrier and no \
         index outside of an array.\nno_hazards = true\n# The resources after the pass:\n# [compute.after.{first}]\n# finite = true\n",
        with.join(", ")
    ))
}

/// Returns the TOML of a texture with sampled texels. The texture is as large as the dispatch.
fn drawn(kind: TextureKind, [width, height]: [u32; 2]) -> Option<String> {
    if kind.multisampled {
        return None;
    }
    let size = match (kind.dimension, kind.arrayed) {
        (Dimension::D1, _) => format!("[{width}]"),
        (Dimension::D2, false) => format!("[{width}, {height}]"),
        (Dimension::D2, true) | (Dimension::D3, _) => format!("[{width}, {height}, 2]"),
        (Dimension::Cube, false) => format!("[{width}]"),
        (Dimension::Cube, true) => format!("[{width}, {width}, 1]"),
    };
    let range = match kind.texels {
        Texels::Float | Texels::Depth => "0..1",
        Texels::Sint | Texels::Uint => "0..99",
    };
    Some(format!("{{ size = {size}, range = \"{range}\" }}"))
}

/// Returns the TOML of an array with sampled elements. The caller passes a `size` if the array is runtime-sized.
fn array(element: &Shape, size: Option<u32>) -> String {
    let size = size.map(|size| format!("size = {size}"));
    let range = range(element).map(|range| format!("range = \"{range}\""));
    match [size, range].into_iter().flatten().collect::<Vec<_>>().join(", ") {
        none if none.is_empty() => "{}".to_owned(),
        keys => format!("{{ {keys} }}"),
    }
}

/// Returns the range for sampled elements, or `None` if the elements aren't numbers or vectors.
fn range(element: &Shape) -> Option<&'static str> {
    let is_number = matches!(element, Shape::Scalar(_) | Shape::Vector { .. });
    is_number.then(|| match element.lanes().first() {
        Some(Scalar::F32 | Scalar::F16) => "0..1",
        _ => "0..99",
    })
}

/// Returns a value of a type as TOML. If the name of an integer suggests a size of the dispatch, such as `width`, the
/// integer gets this size. Other integers get `count`.
fn value(shape: &Shape, name: &str, (usual, count): (&Usual, u32)) -> Option<String> {
    let number = |lane, lanes| {
        let own = usual.number(name, lane, lanes);
        own.unwrap_or(count).to_string()
    };
    Some(match shape {
        Shape::Scalar(Scalar::Bool) => "true".to_owned(),
        Shape::Scalar(scalar) if scalar.is_float() => "1.0".to_owned(),
        Shape::Scalar(_) => number(0, 1),
        Shape::Vector { size, scalar } => {
            let lanes = usize::from(*size);
            let one = |lane| match scalar {
                Scalar::I32 | Scalar::U32 => Some(number(lane, lanes)),
                _ => value(&Shape::Scalar(*scalar), name, (usual, count)),
            };
            format!("[{}]", (0..lanes).map(one).collect::<Option<Vec<_>>>()?.join(", "))
        }
        Shape::Array { element, length } if *length <= SPELLED => {
            let one = value(element, name, (usual, count))?;
            format!("[{}]", vec![one; *length as usize].join(", "))
        }
        Shape::Struct { members, .. } => {
            let own = members.iter().map(|(name, shape)| {
                value(shape, name, (usual, count)).map(|value| format!("{name} = {value}"))
            });
            format!("{{ {} }}", own.collect::<Option<Vec<_>>>()?.join(", "))
        }
        _ => return None,
    })
}
