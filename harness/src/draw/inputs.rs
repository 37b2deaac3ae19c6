//! Checks that meshes have the attributes that vertex functions read.

use super::DrawError;
use super::drawing::Scene;
use super::request::Geometry;
use crate::reflect::Program;

impl Scene<'_> {
    pub(super) fn expect_inputs(&self, program: &Program) -> Result<(), DrawError> {
        for draw in &self.draws {
            let Some(vertex) = &draw.vertex else { continue };
            for input in program.located_inputs(vertex) {
                let takes =
                    format!("`{vertex}` reads `{}` at @location({})", input.name, input.location);
                let unsound = |setting, rest: String| {
                    Err(DrawError::Unsound { setting, reason: format!("{takes}{rest}") })
                };
                let Geometry::Mesh(mesh) = &draw.geometry else {
                    let rest = ", but vertices without a mesh have no attributes: draw a mesh with this attribute";
                    return unsound("vertices", rest.to_owned());
                };
                let own = mesh.attributes.iter().find(|column| column.location == input.location);
                let Some(own) = own else {
                    let rest = ", but the mesh has no attribute at that location: add an attribute";
                    return unsound("mesh", rest.to_owned());
                };
                let scalars = input.shape.lanes();
                if let Some(scalar) = scalars.first().filter(|scalar| **scalar != own.scalar) {
                    let (scalar, own) = (scalar.wgsl(), own.scalar.wgsl());
                    let rest = format!(
                        ", which has components of type `{scalar}`, but the mesh's attribute has components of type `{own}`"
                    );
                    return unsound("mesh", rest);
                }
            }
        }
        Ok(())
    }
}
