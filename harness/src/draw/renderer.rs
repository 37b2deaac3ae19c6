//! Draws a frame with wgpu, and reads the image.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use super::DrawError;
use super::drawing::{Drawing, Scene, Source};
use super::painter::Painter;
use super::row::Row;
use crate::fixture;
use crate::image::Image;
use crate::path::{Device, MOST_ROUNDS, guard};
use crate::probe::{Resource, upload};
use crate::reflect::{Program, Watched};

impl Device {
    pub(crate) fn render(&self, drawing: &Drawing<'_>) -> Result<Image, DrawError> {
        let (width, height) = drawing.size();
        let (mut inexact, mut pixels) = (None, Vec::new());
        self.paint(drawing, &[drawing.scene.result], &mut |_, row, bytes| {
            let rows = || bytes.chunks_exact(row.stride as usize);
            inexact = rows().find_map(|bytes| row.inexact(bytes));
            pixels = rows().flat_map(|bytes| row.pixels(bytes)).collect();
        })?;
        if let Some(value) = inexact {
            let reason = format!(
                "its target contains {value}, but an image stores integers as floats, which are exact up to 16777216: \
                 return a smaller integer, or return the upper and lower 16 bits in two channels"
            );
            return Err(DrawError::Unsound { setting: "target", reason });
        }
        Ok(Image::new(width, height, pixels))
    }

    /// Draws a frame, and returns the texels of `targets` as `u32`s.
    pub(crate) fn texels(
        &self,
        drawing: &Drawing<'_>,
        targets: &[usize],
    ) -> Result<Vec<Vec<[u32; 4]>>, DrawError> {
        let sources: Vec<Source> = targets.iter().copied().map(Source::Target).collect();
        let mut all = vec![Vec::new(); targets.len()];
        self.paint(drawing, &sources, &mut |index, row, bytes| {
            let rows = bytes.chunks_exact(row.stride as usize);
            all[index] = rows.flat_map(|bytes| row.words(bytes)).collect();
        })?;
        Ok(all)
    }

    /// Draws a frame, and calls `read` with the pixels of each entry of `sources`.
    fn paint(
        &self,
        drawing: &Drawing<'_>,
        sources: &[Source],
        read: &mut dyn FnMut(usize, &Row, &[u8]),
    ) -> Result<(), DrawError> {
        let Drawing { scene, program, bindings, .. } = drawing;
        let scene: &Scene<'_> = scene;
        let Scene { width, height, .. } = *scene;
        let limit = self.device.limits().max_texture_dimension_2d;
        if width.min(height) == 0 || width.max(height) > limit {
            return Err(DrawError::Size { width, height, path: self.path(), limit });
        }
        let _turn = self.turn();
        // The key is a variable, because draws may use one binding number for several variables.
        let mut resources: BTreeMap<&str, Resource> = BTreeMap::new();
        let all = drawing.all_bindings();
        for (binding, fixture) in fixture::resolve(&all, drawing.fixtures())? {
            if let Entry::Vacant(entry) = resources.entry(&binding.path) {
                entry.insert(upload(self, program, binding, fixture)?);
            }
        }

        let (module, path) = (scene.module.clone(), self.path());
        let _deadline = guard(path, move || {
            format!("the {width} x {height} frame of module `{module}` on path {path}")
        });
        let unbounded = program.most_rounds().is_none_or(|rounds| rounds >= MOST_ROUNDS);
        if unbounded && self.leaves_loops() {
            watch_rounds(self, scene, program, &mut resources)?;
        }
        let mut painter = Painter::new(self, scene, program, &resources);
        painter.sources = sources.to_vec();
        let buffers = painter.draw(bindings)?;
        for (index, (buffer, source)) in buffers.iter().zip(sources).enumerate() {
            let row = Row::new(painter.format_of(*source), width);
            let size = row.stride * u64::from(height);
            self.read_back(buffer, size, |bytes| read(index, &row, bytes))?;
        }
        Ok(())
    }
}

/// Draws the frame with loops that count their iterations. Some drivers stop long loops without an error, and the
/// counts show such loops.
fn watch_rounds(
    device: &Device,
    scene: &Scene<'_>,
    program: &Program,
    resources: &mut BTreeMap<&str, Resource>,
) -> Result<(), DrawError> {
    let binding = program.free_binding();
    let limit = u32::try_from(MOST_ROUNDS).expect("it fits");
    let Watched { program, loops } = program.watching_rounds(binding, limit, false);
    let size = 4 * loops.len() as u64;
    let buffer = |usage| {
        device.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("rounds"),
            size,
            usage,
            mapped_at_creation: false,
        })
    };
    use wgpu::BufferUsages as Usage;
    let counts = device.checked(|| buffer(Usage::STORAGE | Usage::COPY_SRC))?;
    resources.insert(Watched::VARIABLE, Resource::Buffer(counts.clone()));
    let painter = Painter::new(device, scene, &program, resources);
    drop(painter.draw(&scene.bindings(&program)?)?);
    let staging = device.checked(|| {
        let staging = buffer(Usage::MAP_READ | Usage::COPY_DST);
        let mut encoder = device.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&counts, 0, &staging, 0, size);
        device.queue.submit([encoder.finish()]);
        staging
    })?;
    resources.remove(Watched::VARIABLE);
    let counts: Vec<u32> = device.read_back(&staging, size, bytemuck::pod_collect_to_vec)?;
    let most = loops.iter().zip(counts).max_by_key(|(_, count)| *count);
    match most.filter(|(_, count)| *count > 0) {
        None => Ok(()),
        Some((place, count)) => {
            let of = format!("the frame of module `{}`", scene.module);
            Err(DrawError::Rounds(Box::new(device.left_loop(&of, count, place.as_ref()))))
        }
    }
}
