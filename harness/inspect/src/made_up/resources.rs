//! Generates the buffers, textures and samplers of a function.

use std::collections::BTreeMap;

use karat::fixture::{Address, Buffer, Compare, CubeMap, Fixture, Sampler, Texture};
use karat::unstable::fixture::{Fixtures, without_mips};
use karat::unstable::probe::{ProbeError, Probed};
use karat::unstable::reflect::{Binding, BindingKind, Dimension, Program, Texels};
use karat_core::domain::{Part, Source};
use karat_core::value::{Scalar, Shape};

use super::content::{Numbered, Texels as Held, hashed};
use super::{Content, Declaration, Described, Drawn, End, Extents, Ranges, described};
use crate::limits::{ELEMENTS, MOST_BYTES, MOST_FACE, MOST_SIDE};

/// The upper bound of each random number in the integer texels of a texture.
const MOST: u64 = 16;

/// The seed of all resources. A variable's contents depend on the variable's name, and are the same on every machine.
pub(crate) const SEED: u64 = 0x6d61_7472_6978; // "matrix"

/// Sets the length of each resource that a function writes to the length that Karat generates. If the function computes
/// derivatives, its arguments also get derivatives.
pub(crate) fn fitted(probed: Probed) -> Result<Probed, ProbeError> {
    let mut probed = probed.with_varying();
    if let Ok(made) = Resources::of(&probed, &Ranges::default(), Content::OF_FUNCTIONS[0]) {
        probed.fit(&made.fixtures)?;
    }
    Ok(probed)
}

/// An input in a resource: a member of a buffer, all elements of an array together, or a texture.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Input {
    pub(crate) path: String,
    /// `true` if the input's range is declared, for example in `[inputs]`.
    pub(crate) declared: bool,
    /// `true` if the input isn't free: it is declared, or its name counts as a declaration.
    pub(crate) known: bool,
    lanes: usize,
}

/// The selection of inputs that take their values from another content (another set of generated values).
#[derive(Clone, Copy)]
pub(crate) struct Mix<'m> {
    pub(crate) content: Content,
    /// For a pass: the sizes of the resources in the other content.
    pub(crate) extents: Option<Extents>,
    pub(crate) takes: &'m (dyn Fn(&Input) -> bool + Sync),
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Resources {
    pub(crate) fixtures: Fixtures,
    /// The buffer members outside of arrays, with their values.
    pub(crate) members: Vec<(String, String)>,
    pub(crate) drawn: Drawn,
    /// `true` if there is a resource, so that another content may give other values.
    pub(crate) varies: bool,
    /// The inputs in the resources: members of buffers, arrays and textures.
    pub(crate) inputs: Vec<Input>,
    /// The index of the array element that is being filled.
    element: Option<u32>,
    /// The nesting depth of arrays around the value that is being filled.
    depth: usize,
    /// The lengths of the arrays in all buffers.
    lengths: BTreeMap<String, u32>,
    /// `true` if a pass writes the buffer that is being filled. In such a buffer, an integer outside of arrays begins
    /// at 0, because the pass may use the integer as a counter.
    counts: bool,
}

impl Resources {
    /// Generates resources. Textures and samplers differ from each other, so that exchanging two of them changes the
    /// result. An error names the resource that can't be generated, or the declared range that contains no value of the
    /// input's type.
    pub(crate) fn of(probed: &Probed, ranges: &Ranges, content: Content) -> Result<Self, String> {
        Self::made_of(probed, ranges, (content, None), Likeness::Own)
    }

    /// Generates resources with some inputs from another content.
    pub(crate) fn mixed(
        probed: &Probed,
        ranges: &Ranges,
        content: Content,
        mix: &Mix<'_>,
    ) -> Result<Self, String> {
        Self::made_of(probed, ranges, (content, Some(mix)), Likeness::Own)
    }

    fn made_of(
        probed: &Probed,
        ranges: &Ranges,
        of: (Content, Option<&Mix<'_>>),
        likeness: Likeness,
    ) -> Result<Self, String> {
        let read = (&*probed.program, &*probed.function().bindings);
        let ranges = ranges.scoped(&probed.function().name);
        Self::of_bindings(read, &ranges, of, likeness)
    }

    /// Generates the resources of a compute pass. Their sizes follow from the dispatch.
    pub(crate) fn of_pass(
        of: (&Program, &[Binding]),
        ranges: &Ranges,
        extents: Extents,
        mix: Option<&Mix<'_>>,
    ) -> Result<Self, String> {
        let ranges = Ranges { extents: Some(extents), ..ranges.clone() };
        Self::of_bindings(of, &ranges, (extents.content, mix), Likeness::Own)
    }

    fn of_bindings(
        (program, bindings): (&Program, &[Binding]),
        ranges: &Ranges,
        (content, mix): (Content, Option<&Mix<'_>>),
        likeness: Likeness,
    ) -> Result<Self, String> {
        let mut all = Self { varies: !bindings.is_empty(), ..Self::default() };
        let mut named = Vec::new();
        let elements_of = |binding: &Binding| {
            let usual = match ranges.extents {
                Some(extents) => extents.elements_of(&binding.path),
                // Karat reads a written buffer back, so its length is fixed.
                None if binding.kind.is_written() => ELEMENTS as u32,
                None => content.elements as u32,
            };
            ranges.length(&binding.path, usual, content.draw % 2 == 1) as usize
        };
        let grows =
            |binding: &&Binding| program.buffer_of(binding, 1) != program.buffer_of(binding, 2);
        let of_size = bindings.iter().filter(grows).map(|one| &*one.path);
        ranges.note_sizes(of_size, None, &mut all.drawn);
        let mut elements: BTreeMap<&str, usize> =
            bindings.iter().map(|one| (one.name(), elements_of(one))).collect();
        let length = |binding: &Binding, elements: &BTreeMap<&str, usize>| {
            length_of(&program.buffer_of(binding, elements[binding.name()])?)
        };
        // If elements must differ, there must be enough possible values.
        for binding in bindings {
            if let Some(Declaration::Elements { least: End::Number(least), most, distinct: true }) =
                ranges.get(binding.name())
                && let End::Length(other, less) = most
                && let Some(own) = length(binding, &elements)
                && let Some(places) = elements.get_mut(&**other)
            {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "saturates"
                )]
                let needed = (f64::from(own) + less + least).ceil() as usize;
                let most = ranges.length(other, u32::MAX, false) as usize;
                if needed > most {
                    return Err(format!(
                        "`{}` is declared to have {own} different elements below length({other}), but length({other}) is at most {most}",
                        binding.name()
                    ));
                }
                *places = (*places).max(needed);
            }
        }
        for binding in bindings {
            if let Some(length) = length(binding, &elements) {
                all.lengths.insert(binding.name().to_owned(), length);
            }
        }
        for (place, binding) in bindings.iter().enumerate() {
            let elements = elements[binding.name()];
            let ranges = &ranges.of_buffer(place);
            let fixture = match binding.kind {
                BindingKind::Uniform | BindingKind::Storage { .. } | BindingKind::Immediate => {
                    let of = (program, binding, elements);
                    let mix = mix.map(|mix| Mix {
                        extents: mix.extents.map(|extents| extents.of_buffer(place)),
                        ..*mix
                    });
                    let bytes = all.buffer(of, ranges, (content, mix.as_ref()))?;
                    Some(Buffer::from_bytes(bytes).into())
                }
                _ => {
                    let (declared, known, lanes) = (false, false, 0);
                    let path = binding.name().to_owned();
                    let input = Input { path, declared, known, lanes };
                    let other = mix.filter(|mix| (mix.takes)(&input)).map(|mix| mix.content);
                    all.inputs.push(input);
                    let of = (ranges.extents, ranges.floats());
                    texture_or_sampler(binding, likeness, other.unwrap_or(content), of)
                }
            };
            let fixture = fixture.ok_or_else(|| {
                format!(
                    "the shader reads `{}`, and Karat can't generate data for a {}",
                    binding.path, binding.kind
                )
            })?;
            named.push((binding.path.clone(), fixture));
        }
        Ok(Self { fixtures: named.into_iter().collect(), ..all })
    }

    fn buffer(
        &mut self,
        (program, binding, elements): (&Program, &Binding, usize),
        ranges: &Ranges,
        (content, mix): (Content, Option<&Mix<'_>>),
    ) -> Result<Vec<u8>, String> {
        let shape = program.buffer_of(binding, elements);
        let shape = shape.ok_or_else(|| format!("`{}` has no layout", binding.path))?;
        let first = self.inputs.len();
        let is_written = binding.kind.is_written();
        let mut lanes =
            self.lanes((&binding.path, binding.name(), &shape), ranges, content, is_written)?;
        if let Some(mix) = mix {
            // The buffer has the same type in both contents, and so the same lanes.
            let ranges = Ranges { extents: mix.extents, ..ranges.clone() };
            let of = (&*binding.path, binding.name(), &shape);
            let lengths = self.lengths.clone();
            let other =
                Self { lengths, ..Self::default() }.lanes(of, &ranges, mix.content, is_written)?;
            let mut at = 0;
            for input in &self.inputs[first..] {
                let own = at..at + input.lanes;
                if (mix.takes)(input) {
                    lanes[own.clone()].copy_from_slice(&other[own.clone()]);
                }
                at = own.end;
            }
        }
        program.bytes(binding, &lanes).map_err(|error| error.to_string())
    }

    fn lanes(
        &mut self,
        (path, name, shape): (&str, &str, &Shape),
        ranges: &Ranges,
        Content { draw, .. }: Content,
        is_written: bool,
    ) -> Result<Vec<u32>, String> {
        let mut lanes = Vec::new();
        self.counts = is_written && ranges.numbered().is_some();
        let mut source = source_of(path, draw);
        self.fill((name, shape), ranges, draw.checked_sub(1), &mut source, &mut lanes)?;
        Ok(lanes)
    }

    /// Records an input, whose lanes begin at `from`.
    fn input(&mut self, parts: &[Described], path: &str, from: usize, lanes: &[u32]) {
        let declared = parts.iter().all(|one| one.declared);
        let known = parts.iter().all(|one| one.known);
        let lanes = lanes.len() - from;
        self.inputs.push(Input { path: path.to_owned(), declared, known, lanes });
    }

    /// Samples the lanes of a value. Successive elements of an array get successive preferred numbers.
    fn fill(
        &mut self,
        (path, shape): (&str, &Shape),
        ranges: &Ranges,
        index: Option<usize>,
        source: &mut Source,
        lanes: &mut Vec<u32>,
    ) -> Result<(), String> {
        match shape {
            Shape::Struct { members, .. } => members.iter().try_for_each(|(member, shape)| {
                let path = format!("{path}.{member}");
                // The values don't depend on the order of the members.
                let mut own = source_of(&path, index.map_or(0, |index| index + 1));
                let source = if self.depth == 0 { &mut own } else { &mut *source };
                self.fill((&path, shape), ranges, index, source, lanes)
            }),
            Shape::Array { element, length } => {
                // Elements aren't listed, because a line of a report has no room for them.
                let shown = self.members.len();
                if let Some(declared @ Declaration::Elements { .. }) = ranges.get(path) {
                    let words =
                        self.elements((path, element), declared, *length, ranges, source)?;
                    let input = Input {
                        path: path.to_owned(),
                        declared: true,
                        known: true,
                        lanes: words.len(),
                    };
                    self.inputs.push(input);
                    self.drawn.add(path.to_owned());
                    lanes.extend(words);
                    return Ok(());
                }
                let each = (0..*length as usize).map(|at| index.map(|index| index + at));
                self.depth += 1;
                match **element {
                    Shape::Struct { .. } | Shape::Array { .. } => {
                        for (at, index) in (0..).zip(each) {
                            let number = ranges.numbered().map(|how| how.of(at, *length));
                            let around = std::mem::replace(&mut self.element, number);
                            self.fill((path, element), ranges, index, source, lanes)?;
                            self.element = around;
                        }
                    }
                    // The elements share one description, because there may be a million elements.
                    _ => {
                        let parts = described_elements(path, element, ranges)?;
                        let in_order = parts.iter().all(|one| ranges.numbers_elements(one));
                        let start = lanes.len();
                        if !in_order {
                            parts.iter().for_each(|one| self.drawn.note(one));
                        }
                        for (at, index) in (0..).zip(each) {
                            if let Some(all) = parts
                                .iter()
                                .map(|one| ranges.constant(one))
                                .collect::<Option<Vec<_>>>()
                            {
                                lanes.extend(all.concat());
                                continue;
                            }
                            if let Some(how) = ranges.numbered().filter(|_| in_order) {
                                lanes.extend(parts.iter().map(|_| how.of(at, *length)));
                                continue;
                            }
                            let first = lanes.len();
                            let values = parts.iter().map(|one| one.part.value(index, source));
                            lanes.extend(values.flatten().flatten());
                            ranges.negate(&parts, &mut lanes[first..]);
                        }
                        self.input(&parts, path, start, lanes);
                    }
                }
                self.depth -= 1;
                self.members.truncate(shown);
                Ok(())
            }
            other => {
                let start = lanes.len();
                let parts = described(path, other, ranges)?;
                for one in &parts {
                    if let Some(words) = ranges.constant(one).filter(|_| self.depth > 0) {
                        lanes.extend(words);
                        continue;
                    }
                    if let Some(at) = self.element.filter(|_| ranges.numbers_elements(one)) {
                        lanes.push(at);
                        continue;
                    }
                    if self.counts && self.depth == 0 && ranges.numbers_elements(one) {
                        lanes.push(0);
                        continue;
                    }
                    self.drawn.note(one);
                    let first = lanes.len();
                    lanes.extend(one.part.value(index, source).unwrap_or_default());
                    if self.depth > 0 || ranges.negative {
                        ranges.negate(std::slice::from_ref(one), &mut lanes[first..]);
                    }
                }
                self.input(&parts, path, start, lanes);
                self.members.push((path.to_owned(), other.format(&lanes[start..])));
                Ok(())
            }
        }
    }
}

impl Resources {
    /// The elements of an integer array, as declared: ascending, descending, or in any order.
    fn elements(
        &self,
        (path, element): (&str, &Shape),
        declared: &Declaration,
        length: u32,
        ranges: &Ranges,
        source: &mut Source,
    ) -> Result<Vec<u32>, String> {
        let Declaration::Elements { least, most, distinct } = declared else {
            return Ok(Vec::new());
        };
        if !matches!(element, Shape::Scalar(Scalar::U32 | Scalar::I32)) {
            return Err(format!(
                "the declared elements of `{path}` must be of type u32 or i32, but their type is {element}"
            ));
        }
        let end = |end: &End| match end {
            End::Number(number) => Ok(*number),
            End::Length(name, less) => match self.lengths.get(name) {
                Some(length) => Ok(f64::from(*length) - less),
                None => Err(format!(
                    "the declaration of `{path}` uses length({name}), but no buffer has the name `{name}`"
                )),
            },
        };
        let (least, most) = (end(least)?.ceil(), end(most)?.floor());
        let count = most - least + 1.0;
        if count < 1.0 {
            return Err(format!(
                "`{path}` is declared from {least} to {most}, but this range contains no integer"
            ));
        }
        if *distinct && count < f64::from(length) {
            return Err(format!(
                "`{path}` is declared to have {length} different elements, but there are only {count} numbers from {least} to {most}"
            ));
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "both saturate"
        )]
        let (first, count) = (least as i64, count as u64);
        let number = |at: u64| (first + (at % count).cast_signed()) as u32;
        // Both ends of the range occur: ascending from the smallest value, descending from the largest, or spread over
        // the whole range.
        let all = 0..u64::from(length);
        Ok(match ranges.numbered() {
            Some(Numbered::Forwards) => all.map(number).collect(),
            Some(Numbered::Backwards) => all.map(|at| number(count - 1 - at % count)).collect(),
            _ if *distinct => {
                // A step without a common divisor with the count reaches each number once.
                let divides = |step: &u64| gcd(*step, count) == 1;
                let step = (count / 2 + source.below(count)..).find(divides).unwrap_or(1);
                all.map(|at| number(count - 1 + (at % count) * (step % count))).collect()
            }
            _ => {
                let drawn = |at| if at == 0 { count - 1 } else { source.below(count) };
                all.map(drawn).map(number).collect()
            }
        })
    }
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// The length of a buffer's array. The array is the whole buffer, or its last member.
fn length_of(shape: &Shape) -> Option<u32> {
    match shape {
        Shape::Array { length, .. } => Some(*length),
        Shape::Struct { members, .. } => length_of(&members.last()?.1),
        _ => None,
    }
}

/// The descriptions of an array's elements. The name of an integer in an element doesn't constrain the integer, because
/// the integer may be an index into any array.
fn described_elements(
    path: &str,
    shape: &Shape,
    ranges: &Ranges,
) -> Result<Vec<Described>, String> {
    let mut parts = described(path, shape, ranges)?;
    for one in &mut parts {
        if let [scalar @ (Scalar::U32 | Scalar::I32)] = *one.scalars
            && !one.declared
        {
            one.part = Part::plausible(scalar);
        }
    }
    Ok(parts)
}

impl Ranges {
    /// Checks if a number in an array element follows from the element's index. In some contents, this is the case for
    /// integers without a declaration.
    fn numbers_elements(&self, one: &Described) -> bool {
        let whole = matches!(&*one.scalars, [Scalar::U32 | Scalar::I32]);
        whole && !one.declared && self.numbered().is_some()
    }

    /// The lanes of an element's value, if all elements have the same value.
    fn constant(&self, one: &Described) -> Option<Vec<u32>> {
        // The range that an integer's name suggests may not include the value.
        let whole = matches!(&*one.scalars, [Scalar::U32 | Scalar::I32]);
        let numbered = self.numbered().filter(|_| !one.declared && (whole || one.guessed))?;
        one.scalars.iter().map(|scalar| numbered.constant(*scalar)).collect()
    }

    /// Makes unconstrained numbers negative, if the ranges or the content request it.
    fn negate(&self, parts: &[Described], lanes: &mut [u32]) {
        const SIGN: u32 = 1 << 31;
        if !(self.negative || self.extents.is_some_and(|extents| extents.content.negative)) {
            return;
        }
        let scalars =
            parts.iter().flat_map(|one| one.scalars.iter().map(move |scalar| (one, scalar)));
        for (lane, (one, scalar)) in lanes.iter_mut().zip(scalars) {
            match scalar {
                Scalar::F32 if one.guessed => *lane |= SIGN,
                Scalar::I32 if one.guessed && self.negative => {
                    *lane = lane.cast_signed().saturating_abs().wrapping_neg().cast_unsigned();
                }
                _ => {}
            }
        }
    }

    /// Returns the ranges for one buffer, by its position among all buffers.
    fn of_buffer(&self, place: usize) -> Self {
        let extents = self.extents.map(|extents| extents.of_buffer(place));
        Self { extents, ..self.clone() }
    }

    fn floats(&self) -> &[f32] {
        self.literals.as_ref().map_or(&[], |all| &all.floats)
    }

    fn numbered(&self) -> Option<Numbered> {
        self.extents?.content.numbered
    }
}

/// The choice between equal and different textures and samplers for one function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Likeness {
    /// All textures are equal, and all samplers are equal, so that drivers agree. The samplers have this address mode.
    Equal(Address),
    /// Each variable has a texture or sampler of its own, so that exchanging two of them changes the result.
    Own,
}

/// Generates a fixture for each resource that the function reads. With these fixtures, correct drivers return the same
/// results. An error names the resource that can't be generated.
pub(crate) fn fixtures(
    probed: &Probed,
    ranges: &Ranges,
    beyond: Address,
) -> Result<Fixtures, String> {
    let of = (Content::OF_FUNCTIONS[0], None);
    Ok(Resources::made_of(probed, ranges, of, Likeness::Equal(beyond))?.fixtures)
}

/// The address modes that a function's samplers use, each in a share of the function's cases. With several modes, the
/// results show if a driver confuses two modes.
pub(crate) fn beyond(probed: &Probed) -> &'static [Address] {
    const ALL: [Address; 3] = [Address::Clamp, Address::Repeat, Address::Mirror];
    let mut bindings = probed.function().bindings.iter();
    let samples = bindings.any(|one| one.kind == BindingKind::Sampler { comparison: false });
    if samples { &ALL } else { &ALL[..1] }
}

/// Generates the contents of an entry point's resources. The contents are the same on each path. An error names the
/// resource that can't be generated. A runtime-sized array has an element for each invocation. Samplers repeat, so that
/// a sampler that wrongly clamps changes the result.
pub(crate) fn data(
    program: &Program,
    bindings: &[Binding],
    ranges: &Ranges,
    invocations: usize,
    content: Content,
) -> Result<Vec<(Binding, Fixture)>, String> {
    // The code below rejects buffers with too many elements.
    let elements = invocations.clamp(ELEMENTS, MOST_BYTES / 4 + 1);
    let one = |binding: &Binding| {
        if !matches!(binding.kind, BindingKind::Uniform | BindingKind::Storage { .. }) {
            let made =
                texture_or_sampler(binding, Likeness::Equal(Address::Repeat), content, (None, &[]));
            let none = || {
                format!(
                    "the entry point uses `{}`, and Karat can't generate a {}",
                    binding.path, binding.kind
                )
            };
            return made.map(|fixture| (binding.clone(), fixture)).ok_or_else(none);
        }
        let bytes =
            Resources::default().buffer((program, binding, elements), ranges, (content, None))?;
        if bytes.len() > MOST_BYTES {
            return Err(format!(
                "the entry point uses `{}`, a buffer of {} bytes, and Karat runs entry points only with buffers of at most {MOST_BYTES} bytes",
                binding.path,
                bytes.len()
            ));
        }
        Ok((binding.clone(), Buffer::from_bytes(bytes).into()))
    };
    bindings.iter().map(one).collect()
}

/// The minimum number of an entry point's invocations.
pub(crate) const INVOCATIONS: u32 = 64;

/// The possible sizes of a texture in texels: powers of two, so that each level is half as large as the level above.
const SIDES: [u32; 5] = [16, 8, 32, 4, 64];

/// Random numbers for a variable. The numbers depend on the variable's name, and not on its binding.
fn source_of(path: &str, draw: usize) -> Source {
    let hash = blake3::hash(path.as_bytes());
    let stream = hash.as_bytes().iter().take(8).fold(0, |all, byte| all << 8 | u64::from(*byte));
    Source::new(SEED + draw as u64, stream)
}

/// The width and height of a variable's texture. Textures have different sizes, so that reading the wrong texture's
/// size changes the result.
fn sides(source: &mut Source) -> [u32; 2] {
    let mut side = || SIDES[source.below(SIDES.len() as u64) as usize];
    [side(), side()]
}

fn texture_or_sampler(
    binding: &Binding,
    likeness: Likeness,
    content: Content,
    (extents, literals): (Option<Extents>, &[f32]),
) -> Option<Fixture> {
    let mut source = source_of(&binding.path, content.draw);
    let is_own = likeness == Likeness::Own;
    // Filter weights have only 8 bits. If a texture repeats, its opposite edges must have similar values, or drivers
    // disagree.
    let contrast = match likeness {
        Likeness::Own | Likeness::Equal(Address::Clamp) => 1.0,
        Likeness::Equal(_) => 0.25,
    };
    // Karat reads a written texture back, so its size is fixed.
    let written = matches!(binding.kind, BindingKind::StorageTexture { .. });
    let noise = match content.texels {
        Held::Noise => Some(Noise { least: 0.0, literals }),
        Held::NoiseBelowZero => Some(Noise { least: -0.5, literals }),
        Held::Smooth | Held::Black | Held::OfText(_) => None,
    };
    let sides = match extents {
        // A texture has several rows even for invocations in a line, but at most one for each workgroup, because each
        // workgroup may use one row.
        Some(Extents { elements: [across, down, _], workgroups, .. }) => {
            let rows = workgroups.iter().fold(1_u32, |all, count| all.saturating_mul(*count));
            let part = |side| extents.map_or(side, |extents| extents.part_of(&binding.path, side));
            let sides = [part(across), part(down).max(rows.min(LAYERS))];
            match extents {
                // A square that is larger than the dispatch, with levels down to one texel, for passes that step from
                // level to level.
                Some(extents) if extents.content.long => {
                    [2 * across.max(down).next_power_of_two(); 2]
                }
                _ => sides,
            }
            .map(|side| side.min(MOST_SIDE))
        }
        // The texture is large enough for a square of each number in the text.
        None if noise.is_some() && !written && !literals.is_empty() => [SIDES[SIDES.len() - 1]; 2],
        None => sides(&mut source_of(&binding.path, if written { 0 } else { content.draw })),
    };
    Some(match binding.kind {
        BindingKind::TEXTURE_CUBE => {
            // The factor is a power of two. It distinguishes the texture and loses no digits.
            let own = if is_own { (source.below(9) as f32 - 4.0).exp2() } else { 1.0 };
            let texel = |d: glam::Vec3| own * held_by_halves(d * 0.5 + glam::Vec3::ONE);
            CubeMap::from_fn(sides[0].next_power_of_two().min(MOST_FACE), texel).with_mips().into()
        }
        BindingKind::Texture(kind) => {
            let samples = if kind.multisampled { 4 } else { 1 };
            let own = is_own.then_some((&mut source, content.is_transparent()));
            let of = (kind.dimension, kind.arrayed);
            // All texels are black, white, or one number from the text. A shader may divide by such a texel.
            let constant = match content.texels {
                Held::Black if is_own => Some(0.0),
                Held::OfText(number) if is_own && !literals.is_empty() => {
                    Some(literals[number % literals.len()])
                }
                _ => content.numbered.and_then(|how| how.constant(Scalar::F32)).map(f32::from_bits),
            };
            match (constant, kind.texels) {
                (Some(x), Texels::Float) => {
                    made(kind.dimension, kind.arrayed, sides, samples, |_, _, _| {
                        glam::Vec4::splat(x)
                    })
                    .into()
                }
                _ => texture(of, sides, (kind.texels, noise, contrast), samples, own).into(),
            }
        }
        BindingKind::StorageTexture { dimension, arrayed, format, .. } => {
            let texels = format.texels();
            let own = is_own.then_some((&mut source, content.is_transparent()));
            without_mips(texture((dimension, arrayed), sides, (texels, noise, 1.0), 1, own)).into()
        }
        BindingKind::Sampler { comparison: true } if !is_own => {
            Sampler::LINEAR.compare(Compare::LessEqual).into()
        }
        BindingKind::Sampler { comparison: false } if let Likeness::Equal(beyond) = likeness => {
            Sampler::LINEAR.address([beyond; 3]).into()
        }
        BindingKind::Sampler { comparison: false } => {
            // The smallest level differs between samplers. Textures are smooth, so it changes only the last bits of a
            // result.
            let least = source.unit() as f32;
            let sampler = Sampler::LINEAR.lod(least, 32.0);
            match source.below(3) {
                0 => sampler.into(),
                1 => sampler.mirror().into(),
                _ => sampler.repeat().into(),
            }
        }
        BindingKind::Sampler { comparison: true } => {
            let ways = [Compare::LessEqual, Compare::Less, Compare::GreaterEqual, Compare::Greater];
            Sampler::LINEAR.compare(ways[source.below(4) as usize]).into()
        }
        BindingKind::Uniform
        | BindingKind::Storage { .. }
        | BindingKind::Immediate
        | BindingKind::Other => return None,
    })
}

/// Rounds a texel to numbers that 16-bit floats can represent. On GL, textures with 16-bit floats replace filtered
/// textures of `f32`.
fn held_by_halves(texel: glam::Vec3) -> glam::Vec3 {
    /// The number of steps from one integer to the next. 16-bit floats below 8 can represent all these steps.
    const STEPS: f32 = 128.0;
    (texel * STEPS).round() / STEPS
}

#[derive(Clone, Copy)]
struct Noise<'l> {
    least: f32,
    /// The numbers in the shader's text.
    literals: &'l [f32],
}

impl Noise<'_> {
    /// Returns the value of a texel in a selected square of 4 x 4 texels, or `None` in other squares. A hash selects
    /// about half of the squares. All texels of a selected square have the same value, so filtering doesn't change the
    /// value in the middle of the square. The value is 0, 1, a number from the shader's text, or one of the two floats
    /// next to such a number.
    fn of_text(self, own: f32, [x, y, z, channel]: [u32; 4]) -> Option<f32> {
        const SIDE: u32 = 4;
        if self.literals.is_empty() {
            return None;
        }
        let bits = [x / SIDE, y / SIDE, z].into_iter().fold(own.to_bits() ^ 1, hashed);
        let near = |x: f32| [x, x.next_up(), x.next_down()];
        let all: Vec<f32> = self.literals.iter().flat_map(|x| near(*x)).chain([0.0, 1.0]).collect();
        let own = hashed(bits, channel);
        (bits & 1 == 0).then(|| all[(own >> 8) as usize % all.len()])
    }
}

/// Makes a texture. Its texels are smooth, so that the few bits of a filter's weights hardly matter. With `own`, the
/// texels differ from other variables' texels, may be transparent, and don't change linearly, so that mip levels
/// differ. With noise, neighbouring texels have independent values, except in the squares that [`Noise::of_text`]
/// selects. With a contrast below 1, texels use only a part of their range.
fn texture(
    (dimension, arrayed): (Dimension, bool),
    sides: [u32; 2],
    (texels, noise, contrast): (Texels, Option<Noise<'_>>, f32),
    samples: u32,
    own: Option<(&mut Source, bool)>,
) -> Texture {
    let transparent = own.as_ref().is_some_and(|(_, transparent)| *transparent);
    let (own, whole) = own.map_or((0.0, 0), |(source, _)| {
        let whole = u32::try_from(source.below(MOST)).unwrap_or_default();
        (source.unit() as f32, whole)
    });
    // Only textures that differ between variables have noise. Each texel and each channel has another number.
    let noise = noise.filter(|_| own > 0.0);
    let drawn = |at: [u32; 3], channel: u32| {
        let bits = [at[0], at[1], at[2], channel].into_iter().fold(own.to_bits(), hashed);
        (bits >> 8) as f32 / (1 << 24) as f32
    };
    let wave = |x: u32, y: u32, z: u32| {
        let of_text = |channel| noise?.of_text(own, [x, y, z, channel]);
        if let [Some(r), Some(g), Some(b), Some(a)] = [0, 1, 2, 3].map(of_text) {
            return glam::Vec4::new(r, g, b, a);
        }
        if let Some(Noise { least, .. }) = noise {
            let texel =
                glam::Vec4::from_array([0, 1, 2, 3].map(|channel| drawn([x, y, z], channel)));
            let color = held_by_halves(texel.truncate() * (1.0 - least) + least);
            return color.extend(if transparent { texel.w } else { 1.0 });
        }
        let [x, y] = [(x, sides[0]), (y, sides[1])].map(|(n, side)| n as f32 / side as f32);
        let z = z as f32 / LAYERS as f32;
        let (x, y) = (x + 0.25 * own * x * x, y - 0.25 * own * y * y);
        let texel = glam::Vec3::new(x + own, y, 0.5 * (x + y) + 0.25 * z);
        let texel = held_by_halves(texel * contrast + (1.0 - contrast));
        // The alpha channel contains 0, for shaders that divide by alpha.
        texel.extend(if transparent { texel.y.clamp(0.0, 1.0) } else { 1.0 })
    };
    let number = |x: u32, y: u32, z: u32| match noise {
        Some(_) => (drawn([x, y, z], 0) * MOST as f32) as u32 + whole,
        None => x + y + z + whole,
    };
    match texels {
        Texels::Float => {
            let texture = made(dimension, arrayed, sides, samples, wave);
            // 1D textures and multisampled textures have one level.
            let halve = sides.iter().all(|side| side.is_power_of_two());
            match (samples, dimension) {
                (1, Dimension::D2 | Dimension::D3 | Dimension::Cube) if halve => {
                    texture.with_mips()
                }
                // The texture is as large as the dispatch. A level contains every second texel of the level above.
                (1, Dimension::D2) if !arrayed => {
                    let last = sides[0].max(sides[1]).ilog2();
                    let level = |n: u32| {
                        let sides = sides.map(|side| (side >> n).max(1));
                        made(dimension, arrayed, sides, 1, |x, y, z| wave(x << n, y << n, z))
                    };
                    texture.with_levels((1..=last).map(level))
                }
                _ => texture,
            }
        }
        Texels::Depth => made(dimension, arrayed, sides, samples, |x, y, z| match noise {
            Some(noise) => noise
                .of_text(own, [x, y, z, 0])
                .unwrap_or_else(|| drawn([x, y, z], 0))
                .clamp(0.0, 1.0),
            None => 0.5 * own + 0.5 * (x + y + z) as f32 / (sides[0] + sides[1] + LAYERS) as f32,
        }),
        Texels::Sint => {
            made(dimension, arrayed, sides, samples, |x, y, z| number(x, y, z).cast_signed() - 4)
        }
        Texels::Uint => made(dimension, arrayed, sides, samples, number),
    }
}

/// Makes a texture. `value` returns a texel for a column, a row, and a slice, layer or sample.
fn made<T: karat::Shareable>(
    dimension: Dimension,
    arrayed: bool,
    [width, height]: [u32; 2],
    samples: u32,
    value: impl Fn(u32, u32, u32) -> T,
) -> Texture {
    let layer = |z: u32| Texture::from_fn(width, height, |x, y| value(x, y, z));
    let side = width.min(MOST_FACE);
    let face = |z: u32| Texture::from_fn(side, side, |x, y| value(x, y, z));
    match (dimension, arrayed) {
        (Dimension::D1, _) => Texture::from_fn_1d(width, |x| value(x, 0, 0)),
        (Dimension::D2, false) if samples > 1 => {
            Texture::multisampled(width, height, samples, value)
        }
        (Dimension::D2, false) => layer(0),
        (Dimension::D2, true) => Texture::array((0..LAYERS).map(layer)),
        (Dimension::D3, _) => Texture::volume([width, height, LAYERS], value),
        (Dimension::Cube, false) => Texture::cube((0..6).map(face)),
        (Dimension::Cube, true) => Texture::cube_array((0..12).map(face)),
    }
}

const LAYERS: u32 = 4;

#[cfg(test)]
mod tests {
    use karat::unstable::fixture::{bytes, levels};

    use super::*;

    /// The textures of a pass are as large as the dispatch, and have several levels.
    #[test]
    fn textures_of_any_size_have_levels() {
        for (sides, count) in [([16, 16], 5), ([16, 24], 5), ([13, 3], 4), ([1, 1], 1)] {
            let made = texture((Dimension::D2, false), sides, (Texels::Float, None, 1.0), 1, None);
            let fixture = Fixture::from(made);
            let levels = levels(&fixture).len();
            assert_eq!(levels, count, "{sides:?}");
        }
    }

    fn probed(text: &str) -> Probed {
        let package = karat::Package::from_source("p", text);
        Probed::new(&package, "f").expect("`f` can be called")
    }

    fn words(made: &Resources, name: &str) -> Vec<u32> {
        let found = made.fixtures.iter().find(|(path, _)| path == name);
        let Some((_, Fixture::Buffer(buffer))) = found else { panic!("no `{name}`") };
        bytemuck::pod_collect_to_vec(bytes(buffer))
    }

    /// An array that is only read has a different length in some contents: a short array reveals a missing bounds
    /// check. A written array has a fixed length, because Karat reads it back.
    #[test]
    fn arrays_that_are_read_have_several_lengths() {
        let probed = probed(
            "@group(0) @binding(0) var<storage, read> d: array<f32>;
            @group(0) @binding(1) var<storage, read_write> w: array<f32>;
            fn f(i: u32) -> f32 { w[i] = d[i]; return d[i]; }",
        );
        let made = |content| {
            Resources::of(&probed, &Ranges::default(), content)
                .expect("the resources are generated")
        };
        let lengths =
            |name: &str| Content::OF_FUNCTIONS.map(|content| words(&made(content), name).len());
        assert_eq!(lengths("d"), [64, 64, 16, 64, 3, 64]);
        assert_eq!(lengths("w"), [64; 6]);
        // Elements have the preferred numbers in turn.
        let first = words(&made(Content::OF_FUNCTIONS[1]), "d");
        assert!(first[0] != first[1] && first[1] != first[2], "{first:?}");
    }

    /// Textures that are only read have another size in each content. Written textures have a fixed size, because Karat
    /// reads them back.
    #[test]
    fn written_textures_keep_their_size() {
        let probed = probed(
            "@group(0) @binding(0) var image: texture_2d<f32>;
            @group(0) @binding(1) var stored: texture_storage_2d<r32float, write>;
            fn f(i: u32) -> f32 {
                textureStore(stored, vec2u(i), vec4f(1.0));
                return textureLoad(image, vec2u(i), 0).x;
            }",
        );
        let sizes = |name: &str| {
            let size = |content| {
                let made = Resources::of(&probed, &Ranges::default(), content)
                    .expect("the resources are generated");
                let (_, fixture) = made.fixtures.iter().find(|(path, _)| path == name)?;
                levels(fixture).first().map(|level| (level.width, level.height))
            };
            std::collections::BTreeSet::from(Content::OF_FUNCTIONS.map(size)).len()
        };
        assert_eq!(sizes("stored"), 1);
        assert!(sizes("image") > 2);
    }

    /// Only undeclared integers in array elements get the values 0, 1, 2 and so on. A member after an array doesn't get
    /// these values, and neither does a declared integer.
    #[test]
    fn integers_after_an_array_are_not_numbered() {
        let text =
            "struct Item { id: u32, next: i32 } struct S { items: array<Item, 4>, mode: u32 }
            @group(0) @binding(0) var<storage, read> s: S;
            @group(0) @binding(1) var<storage, read> given: array<u32, 3>;
            @group(0) @binding(2) var<storage, read_write> sum: array<u32>;
            @compute @workgroup_size(64) fn f(@builtin(global_invocation_id) g: vec3u) {
                sum[g.x] = s.items[g.x].id + s.mode + given[g.x % 3u];
            }";
        let package = karat::Package::from_source("p", text);
        let (program, bindings, size) =
            Program::of_pass(&package, "f", &karat::unstable::reflect::Overrides::new())
                .expect("a pass");
        let mut ranges = Ranges::default();
        ranges.declare("given", 7.0, 7.0).expect("the range is valid");
        let of = |content: Content| {
            let extents = Extents::of(size, [2, 1, 1], content);
            let made = Resources::of_pass((&program, &bindings), &ranges, extents, None);
            let made = made.expect("the resources are generated");
            (words(&made, "s")[..9].to_vec(), words(&made, "given")[..3].to_vec())
        };
        let [first, second, ..] = Content::OF_PASSES;
        assert_eq!(of(first), (vec![0, 0, 1, 1, 2, 2, 3, 3, 1], vec![7; 3]));
        assert_eq!(of(second), (vec![3, 3, 2, 2, 1, 1, 0, 0, 1], vec![7; 3]));
        assert_eq!(of(first.numbered(Numbered::One)), (vec![1; 9], vec![7; 3]));
    }

    /// A mixed-in input gets the value that it has in the other content. All other inputs keep their values.
    // Lesson 99
    #[test]
    fn mixing_in_an_input_changes_only_its_words() {
        let probed = probed(
            "struct Item { id: u32, gain: f32 } struct S { a: f32, b: vec2f, items: array<Item, 3> }
            @group(0) @binding(0) var<storage, read> s: S;
            fn f(i: u32) -> f32 { return s.a * s.b.x * s.items[i].gain; }",
        );
        let ranges = Ranges::default();
        let plain = |content| {
            words(
                &Resources::of(&probed, &ranges, content).expect("the resources are generated"),
                "s",
            )
        };
        let [of_own, _, _, of_other, ..] = Content::OF_FUNCTIONS;
        let [own, other] = [of_own, of_other].map(plain);
        let mixed = |path: &'static str| {
            let takes = move |input: &Input| input.path == path;
            let mix = Mix { content: of_other, extents: None, takes: &takes };
            words(
                &Resources::mixed(&probed, &ranges, of_own, &mix)
                    .expect("the resources are generated"),
                "s",
            )
        };
        let changed = |path| {
            let mixed = mixed(path);
            let all = (0..own.len()).filter(|at| mixed[*at] != own[*at]);
            let all: Vec<usize> = all.collect();
            assert!(all.iter().all(|at| mixed[*at] == other[*at]), "{path}");
            all
        };
        assert_eq!(changed("s.a"), [0]);
        assert!(changed("s.b").iter().all(|at| (2..4).contains(at)), "{:?}", changed("s.b"));
        assert!(changed("s.items.gain").iter().all(|at| at % 2 == 1 && *at > 4));
        assert_eq!(changed("s.none"), [0; 0]);
    }

    /// Values depend on the members' names, not on their order.
    #[test]
    fn generated_members_do_not_depend_on_their_order() {
        let of = |members: &str, content| {
            let probed = probed(&format!(
                "struct Q {{ u: f32, v: f32 }} struct L {{ l: vec4f }} struct P {{ {members} }}
                @group(0) @binding(0) var<storage, read> p: P;
                fn f(x: f32) -> f32 {{ return x * p.a * p.b.y * p.q.v * f32(p.c) * p.list[1].l.x; }}"
            ));
            let made = Resources::of(&probed, &Ranges::default(), content)
                .expect("the resources are generated");
            let mut members = made.members;
            members.sort_unstable();
            assert_eq!(members.len(), 5);
            members
        };
        for content in Content::OF_FUNCTIONS {
            let one = of("a: f32, b: vec2f, q: Q, c: u32, list: array<L, 3>", content);
            assert_eq!(of("c: u32, q: Q, list: array<L, 3>, b: vec2f, a: f32", content), one);
            assert_eq!(of("list: array<L, 3>, b: vec2f, c: u32, a: f32, q: Q", content), one);
        }
    }

    /// In one content, unconstrained floats are negative. A read outside of an array gives 0, which is larger than all
    /// of them.
    #[test]
    fn floats_of_one_content_are_below_zero() {
        let text = "struct P { mass: f32, other: f32 }
            @group(0) @binding(0) var<storage, read> d: array<f32>;
            @group(0) @binding(1) var<storage, read> p: array<P>;
            @group(0) @binding(2) var<storage, read> roughness: array<f32>;
            @group(0) @binding(3) var<storage, read_write> sum: array<f32>;
            @compute @workgroup_size(64) fn f(@builtin(global_invocation_id) g: vec3u) {
                sum[g.x] = d[g.x] + p[g.x].other + roughness[g.x];
            }";
        let package = karat::Package::from_source("p", text);
        let (program, bindings, size) =
            Program::of_pass(&package, "f", &karat::unstable::reflect::Overrides::new())
                .expect("a pass");
        let positive = |name: &str| {
            let all = (0..Content::OF_PASSES.len()).filter(|number| {
                let extents = Extents::of(size, [2, 1, 1], Content::OF_PASSES[*number]);
                let of = (&*program, &*bindings);
                let made = Resources::of_pass(of, &Ranges::default(), extents, None);
                let floats = words(&made.expect("the resources are generated"), name).into_iter();
                floats.map(f32::from_bits).any(|x| x > 0.0)
            });
            all.collect::<Vec<_>>()
        };
        assert_eq!([positive("d"), positive("p")], [[0, 1, 2, 3, 5, 6, 7, 8]; 2]);
        assert_eq!(positive("roughness"), [0, 1, 2, 3, 4, 5, 6, 7, 8], "its name suggests a range");
    }

    // Lesson 132
    #[test]
    fn differentiated_arguments_vary() {
        let text = "fn f(a: f32, k: u32, v: vec2f) -> f32 { return dpdx(a) + dpdy(v.x) + f32(k); }";
        let probed = Probed::new(&karat::Package::from_source("p", text), "f").and_then(fitted);
        let rows = crate::work::rows(
            &probed.expect("`f` can be called"),
            &Ranges::default(),
            &Fixtures::default(),
            64,
        )
        .expect("drawn");
        // Each row has `a` with `dx` and `dy`, then `k`, then `v` with `dx` and `dy`.
        let cases = || rows.chunks_exact(3 + 1 + 6).skip(32);
        for slope in [1, 2, 6, 8] {
            let varying = cases().filter(|row| f32::from_bits(row[slope]) != 0.0).count();
            assert!(2 * varying > cases().count(), "{varying} cases have slope {slope}");
        }
    }
}
