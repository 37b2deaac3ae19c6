//! The draws of a `[[frame]]`, with meshes from tables, depth and blending.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{IVec2, IVec3, IVec4, UVec2, UVec3, UVec4, Vec2, Vec3, Vec4};
use karat::draw::{Blend, Cull, Draw, Mesh};
use karat::fixture::Compare;
use karat::unstable::reflect::Program;
use karat::unstable::value::{Scalar, Shape};
use serde::Deserialize;

use crate::domains::no_such;
use crate::numbers::Wanted;
use crate::table;
use crate::wrong::Misdeclared;

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Declared {
    /// The vertex function. By default, one triangle covers the frame.
    pub(crate) vertex: Option<String>,
    /// The fragment function. Without one, the draw writes only depth.
    pub(crate) fragment: Option<String>,
    /// A CSV file with a row for each vertex. The columns are the vertex function's inputs with a `@location`. Location
    /// 0 is the position.
    mesh: Option<PathBuf>,
    /// The vertices of each triangle, as row numbers from 0. By default, every three rows are a triangle.
    indices: Option<Vec<u32>>,
    /// The number of vertices of a draw without a mesh. The vertex function reads `@builtin(vertex_index)`. The default
    /// is 3.
    vertices: Option<u32>,
    /// The number of instances. The default is 1.
    instances: Option<u32>,
    /// The faces that the draw leaves out: `"none"`, `"front"` or `"back"`.
    cull: Option<String>,
    /// The depth comparison that decides if a pixel is drawn, by WebGPU's name: `"less"`, `"greater-equal"`.
    depth_compare: Option<String>,
    /// Makes the draw write depth: `true`.
    depth_write: Option<bool>,
    /// The operation that blends the draw's colours with the colours in the frame: `"replace"`, `"add"`, `"alpha"`,
    /// `"premultiplied"` or `"multiply"`.
    blend: Option<String>,
}

const CULLS: [(&str, Cull); 3] =
    [("none", Cull::None), ("front", Cull::Front), ("back", Cull::Back)];

const COMPARES: [(&str, Compare); 8] = [
    ("never", Compare::Never),
    ("less", Compare::Less),
    ("equal", Compare::Equal),
    ("less-equal", Compare::LessEqual),
    ("greater", Compare::Greater),
    ("not-equal", Compare::NotEqual),
    ("greater-equal", Compare::GreaterEqual),
    ("always", Compare::Always),
];

const BLENDS: [(&str, Blend); 5] = [
    ("replace", Blend::Replace),
    ("add", Blend::Add),
    ("alpha", Blend::Alpha),
    ("premultiplied", Blend::Premultiplied),
    ("multiply", Blend::Multiply),
];

fn named<T: Copy>(
    (key, what): (&'static str, &str),
    all: &[(&str, T)],
    name: &str,
) -> Result<T, Misdeclared> {
    let known = all.iter().map(|(known, _)| *known);
    let found = all.iter().find(|(known, _)| *known == name);
    let found = found.map(|(_, value)| *value);
    found.ok_or_else(|| Misdeclared::of(key)(no_such(what, name, known)))
}

impl Declared {
    pub(crate) fn covering(vertex: Option<String>, fragment: String) -> Self {
        Self {
            vertex,
            fragment: Some(fragment),
            mesh: None,
            indices: None,
            vertices: None,
            instances: None,
            cull: None,
            depth_compare: None,
            depth_write: None,
            blend: None,
        }
    }

    pub(crate) fn mesh_file(&self, folder: &Path) -> Option<PathBuf> {
        Some(folder.join(self.mesh.as_ref()?))
    }

    /// Makes the draw. `lacks` is `true` if one of the frame's functions doesn't exist. Then this method doesn't read
    /// the mesh, because the frame's check reports the missing function.
    pub(crate) fn draw(
        &self,
        program: &Arc<Program>,
        folder: &Path,
        lacks: bool,
    ) -> Result<Draw, Misdeclared> {
        let wrong = |message: &str| Misdeclared::from(message);
        if lacks && self.mesh.is_some() {
            let vertex = self.vertex.as_deref().unwrap_or_default();
            let fragment = self.fragment.as_deref().unwrap_or(vertex);
            return Ok(Draw::vertices(vertex, fragment, 3));
        }
        let mut draw = match (&self.vertex, &self.fragment, &self.mesh, self.vertices) {
            (_, _, Some(_), Some(_)) => {
                return Err(wrong(
                    "a draw can't have both a `mesh` and a number of `vertices`: remove one of the keys",
                ));
            }
            (None, _, Some(_), _) | (None, _, _, Some(_)) => {
                return Err(wrong(
                    "`mesh` and `vertices` need a `vertex` function: name the function",
                ));
            }
            (None, None, ..) => {
                return Err(wrong("a draw needs a `fragment` or a `vertex` function"));
            }
            (None, Some(fragment), None, None) => Draw::fragment(fragment),
            (Some(vertex), None, Some(_), None) => {
                Draw::depth(vertex, self.read(program, vertex, folder)?)
            }
            (Some(_), None, ..) => {
                return Err(wrong(
                    "a draw without a `fragment` function needs a `mesh`: name a mesh",
                ));
            }
            (Some(vertex), Some(fragment), Some(_), None) => {
                Draw::mesh(vertex, fragment, self.read(program, vertex, folder)?)
            }
            (Some(vertex), Some(fragment), None, None) => Draw::fullscreen(vertex, fragment),
            (Some(vertex), Some(fragment), None, Some(count)) => {
                if count == 0 || count % 3 != 0 {
                    return Err(wrong(&format!(
                        "the number of vertices must be a positive multiple of 3, but is {count}"
                    )));
                }
                Draw::vertices(vertex, fragment, count)
            }
        };
        if self.indices.is_some() && self.mesh.is_none() {
            return Err(wrong("`indices` need a `mesh`: name a mesh"));
        }
        if let Some(instances) = self.instances {
            if instances == 0 {
                return Err(Misdeclared::of("instances")(
                    "0 instances draw nothing: write at least 1".to_owned(),
                ));
            }
            draw = draw.instances(instances);
        }
        if let Some(cull) = &self.cull {
            draw = draw.cull(named(("cull", "cull mode"), &CULLS, cull)?);
        }
        if let Some(compare) = &self.depth_compare {
            draw = draw.depth_compare(named(("depth_compare", "comparison"), &COMPARES, compare)?);
        }
        if let Some(write) = self.depth_write {
            draw = draw.depth_write(write);
        }
        if let Some(blend) = &self.blend {
            draw = draw.blend(named(("blend", "blending"), &BLENDS, blend)?);
        }
        Ok(draw)
    }

    /// Reads the mesh, which has a column for each input of the vertex function.
    fn read(
        &self,
        program: &Arc<Program>,
        vertex: &str,
        folder: &Path,
    ) -> Result<Mesh, Misdeclared> {
        let file = self.mesh_file(folder).expect("the draw has a mesh");
        let wrong = |message: String| Misdeclared::of("mesh")(message);
        let inputs = program.located_inputs(vertex);
        let first = inputs.iter().find(|input| input.location == 0);
        let is_position = |shape: &Shape| {
            let lanes = shape.lanes();
            matches!(lanes.len(), 2 | 3) && lanes.iter().all(|lane| *lane == Scalar::F32)
        };
        if !first.is_some_and(|input| is_position(&input.shape)) {
            return Err(wrong(format!(
                "`{vertex}` must read the mesh's position at `@location(0)`, as a vector of two or three floats"
            )));
        }
        let parameters: Vec<(String, Shape)> =
            inputs.iter().map(|input| (input.name.clone(), input.shape.clone())).collect();
        // The mesh is read as a table of arguments without expected results.
        let nothing = Shape::Struct { name: String::new(), members: Vec::new() };
        let table = table::read(&file, &parameters, &nothing, Wanted::Equal)?;
        let count = table.rows.len();
        let indices = match &self.indices {
            Some(indices) => indices.clone(),
            None => (0..u32::try_from(count).unwrap_or(u32::MAX)).collect(),
        };
        if indices.is_empty() || indices.len() % 3 != 0 {
            return Err(wrong(format!(
                "the mesh's number of triangle corners must be a positive multiple of 3, but is {}",
                indices.len()
            )));
        }
        if let Some(beyond) = indices.iter().find(|index| **index as usize >= count) {
            return Err(wrong(format!(
                "the index {beyond} is too large: the mesh has {count} vertices"
            )));
        }
        // The index of an input's first lane among the lanes of all inputs.
        let start = |number: usize| -> usize {
            parameters[..number].iter().map(|(_, shape)| shape.lanes().len()).sum()
        };
        let column = |number: usize| -> Vec<Vec<u32>> {
            let lanes = start(number)..start(number + 1);
            table.rows.iter().map(|row| row[lanes.clone()].to_vec()).collect()
        };
        let place = inputs.iter().position(|input| input.location == 0).unwrap_or_default();
        let position = |row: Vec<u32>| {
            let lane = |k: usize| row.get(k).map_or(0.0, |word| f32::from_bits(*word));
            Vec3::new(lane(0), lane(1), lane(2))
        };
        let positions = column(place).into_iter().map(position).collect();
        let mut mesh = Mesh::new(positions, indices);
        for (number, input) in inputs.iter().enumerate().filter(|(_, input)| input.location != 0) {
            mesh = with_attribute(mesh, input.location, &input.shape, &column(number)).ok_or_else(
                || {
                    wrong(format!(
                        "`{}` has a type that can't be a mesh attribute: {}",
                        input.name, input.shape
                    ))
                },
            )?;
        }
        Ok(mesh)
    }
}

/// Adds an input's value for each vertex to the mesh; `None` if the type can't be an attribute.
fn with_attribute(mesh: Mesh, location: u32, shape: &Shape, rows: &[Vec<u32>]) -> Option<Mesh> {
    let lanes = shape.lanes();
    let float = |row: &[u32]| row.iter().map(|word| f32::from_bits(*word)).collect::<Vec<_>>();
    let signed = |row: &[u32]| row.iter().map(|word| word.cast_signed()).collect::<Vec<_>>();
    macro_rules! values {
        ($of:expr) => {
            mesh.attribute(location, &rows.iter().map(|row| $of(row)).collect::<Vec<_>>())
        };
    }
    Some(match (lanes.first()?, lanes.len()) {
        (Scalar::F32, 1) => values!(|row| float(row)[0]),
        (Scalar::F32, 2) => values!(|row| Vec2::from_slice(&float(row))),
        (Scalar::F32, 3) => values!(|row| Vec3::from_slice(&float(row))),
        (Scalar::F32, 4) => values!(|row| Vec4::from_slice(&float(row))),
        (Scalar::I32, 1) => values!(|row| signed(row)[0]),
        (Scalar::I32, 2) => values!(|row| IVec2::from_slice(&signed(row))),
        (Scalar::I32, 3) => values!(|row| IVec3::from_slice(&signed(row))),
        (Scalar::I32, 4) => values!(|row| IVec4::from_slice(&signed(row))),
        (Scalar::U32, 1) => values!(|row: &Vec<u32>| row[0]),
        (Scalar::U32, 2) => values!(|row: &Vec<u32>| UVec2::from_slice(row)),
        (Scalar::U32, 3) => values!(|row: &Vec<u32>| UVec3::from_slice(row)),
        (Scalar::U32, 4) => values!(|row: &Vec<u32>| UVec4::from_slice(row)),
        _ => return None,
    })
}
