//! A first `[[compute]]` for a compute entry point: resources that follow from what is dispatched.

use karat::Package;
use karat::unstable::dispatch::Usual;
use karat::unstable::package::FunctionItem;
use karat::unstable::reflect::{BindingKind, Dimension, Program, Stage, Texels, TextureKind};
use karat::value::{Scalar, Shape};

/// Elements of arrays without a length, at least.
const LEAST: u32 = 64;

/// Elements of an array with a length that a test spells out.
const SPELLED: u32 = 16;

/// The assertion about a pass itself, where none about its resources holds.
const NO_HAZARDS: &str = "no_hazards = true";

/// The declarations that are tried, the most telling first. None if a resource has no size that follows, or nothing is
/// written.
pub(super) fn declarations(package: &Package, item: &FunctionItem) -> Vec<String> {
    let (module, name) = item.name.rsplit_once("::").unwrap_or(("", &item.name));
    let Ok(program) = Program::of_items(package, module, &[name]) else { return Vec::new() };
    let Ok(usual) = Usual::of(package, &item.name) else { return Vec::new() };
    // Each invocation may have several elements, and each number may be the side of a matrix.
    let of_size =
        |(each, sides)| declared(&program, name, &usual, (each, sides)).unwrap_or_default();
    let sizes = [(1, false), (2, false), (4, false), (1, true)];
    let mut all: Vec<String> = sizes.into_iter().flat_map(of_size).collect();
    // Assertions about resources say more.
    all.sort_by_key(|text| text.contains(NO_HAZARDS));
    all
}

/// Those whose arrays have so many elements an invocation, and whose numbers count these, or are `sides` of what is
/// dispatched.
fn declared(
    program: &Program,
    name: &str,
    usual: &Usual,
    (each, sides): (u32, bool),
) -> Option<Vec<String>> {
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
    let elements = invocations.max(LEAST).checked_mul(each)?;
    let numbers = match sides {
        true => (None, size[0].checked_mul(groups[0])?),
        false => (Some(usual), elements),
    };
    let (mut with, mut written) = (Vec::new(), Vec::new());
    for binding in &bindings {
        let [width, height] = [0, 1].map(|k| size[k] * groups[k]);
        match binding.kind {
            BindingKind::StorageTexture { dimension: Dimension::D2, arrayed: false, .. } => {
                with.push(format!("{} = {{ size = [{width}, {height}] }}", binding.name()));
                if program.writes(name, binding) {
                    written.push((binding.name().to_owned(), true));
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
            // A structure that ends in an array has no value that a person writes.
            _ if grows => return None,
            // Too long to be spelt out.
            Shape::Array { element, length } if *length > SPELLED => array(element, None),
            _ => value(&shape, binding.name(), numbers)?,
        };
        with.push(format!("{} = {value}", binding.name()));
        if program.writes(name, binding) {
            written
                .push((binding.name().to_owned(), shape.lanes().iter().any(|one| one.is_float())));
        }
    }
    let [x, y, z] = groups;
    let head = format!(
        "[[compute]]\nentry = \"{name}\"\nworkgroups = [{x}, {y}, {z}]\n# What the resources hold before: values, \
         files, or so many elements of a range.\nwith = {{ {} }}\n",
        with.join(", ")
    );
    let floats = written.iter().any(|(_, floats)| *floats);
    let mut all = Vec::new();
    for assertions in [&["written", "finite"][..], &["written"], &["finite"]] {
        if assertions.contains(&"finite") && !floats {
            continue;
        }
        let mut text = head.clone();
        for (name, floats) in &written {
            let own = assertions.iter().filter(|one| **one != "finite" || *floats);
            let own: String = own.map(|one| format!("{one} = true\n")).collect();
            if !own.is_empty() {
                text += &format!("[compute.after.{name}]\n{own}");
            }
        }
        all.push(text);
    }
    // Where some elements aren't written, or none are floats.
    all.push(head.replacen("\nworkgroups", &format!("\n{NO_HAZARDS}\nworkgroups"), 1));
    Some(if written.is_empty() { Vec::new() } else { all })
}

/// A texture as large as what is dispatched, of which each texel is drawn.
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

/// An array, with its size if the shader doesn't say its length.
fn array(element: &Shape, size: Option<u32>) -> String {
    let size = size.map(|size| format!("size = {size}"));
    let range = range(element).map(|range| format!("range = \"{range}\""));
    match [size, range].into_iter().flatten().collect::<Vec<_>>().join(", ") {
        none if none.is_empty() => "{}".to_owned(),
        keys => format!("{{ {keys} }}"),
    }
}

/// The range of elements that are numbers or vectors.
fn range(element: &Shape) -> Option<&'static str> {
    let is_number = matches!(element, Shape::Scalar(_) | Shape::Vector { .. });
    is_number.then(|| match element.lanes().first() {
        Some(Scalar::F32 | Scalar::F16) => "0..1",
        _ => "0..99",
    })
}

/// A value of which a whole number is what its name says, by what is dispatched, or else so large.
fn value(shape: &Shape, name: &str, (usual, count): (Option<&Usual>, u32)) -> Option<String> {
    let number = |lane, lanes| {
        let own = usual.and_then(|usual| usual.number(name, lane, lanes));
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
