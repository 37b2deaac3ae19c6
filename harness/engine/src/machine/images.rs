//! Runs operations on textures.

use super::{Machine, Memory};
use crate::arithmetic::sealed::Rules;
use crate::code::{Detail, ImageKind, ImageOp};
use crate::races::{Accessed, Place};
use crate::texture::{self, Dimension, Level, Many, Mean, Sampler, TOGETHER, Texture};

struct Operands<'a> {
    outs: &'a [u32],
    floats: &'a [u32],
    ints: &'a [u32],
}

impl<A: Rules> Machine<'_, A> {
    pub(super) fn image(&mut self, image: u32, registers: &[u32], memory: &Memory<'_, A>) {
        let op = &self.code.images[image as usize];
        let texture: &Texture = &memory.textures[op.texture as usize];
        let outs = op.outs.iter().sum::<u32>() as usize;
        let (outs, ins) = registers.split_at(outs);
        let (floats, ints) = ins.split_at(op.ins[0] as usize);
        let operands = Operands { outs, floats, ints };
        match op.kind {
            ImageKind::Store(_) => {}
            ImageKind::Levels => self.uniform(outs[0], texture.levels()),
            ImageKind::Samples => self.uniform(outs[0], texture.samples()),
            ImageKind::Layers => {
                let faces = if texture.dimension() == Dimension::Cube { 6 } else { 1 };
                self.uniform(outs[0], texture.size()[2] / faces);
            }
            ImageKind::Size => self.size(op, texture, &operands),
            ImageKind::Load { .. } => self.load_texels(op, texture, &operands),
            ImageKind::Sample { .. } => {
                if let Some(&sampler) = memory.samplers.get(op.sampler as usize) {
                    self.sample(op, texture, sampler, &operands);
                }
            }
        }
    }

    /// Writes texels. Texels outside of the texture aren't written, as WebGPU requires.
    pub(super) fn image_store(
        &mut self,
        image: u32,
        registers: &[u32],
        memory: &mut Memory<'_, A>,
    ) {
        let op = &self.code.images[image as usize];
        let ImageKind::Store(format) = op.kind else { return };
        let (floats, ints) = registers.split_at(op.ins[0] as usize);
        let texture = memory.textures[op.texture as usize].to_mut();
        let size = texture.level_size(0);
        let coordinates = op.coordinates as usize;
        for lane in 0..self.width {
            if !self.acts(lane) {
                continue;
            }
            let mut at = [0; 3];
            let mut outside = false;
            let indices = &ints[..coordinates + usize::from(op.arrayed)];
            for (k, &register) in indices.iter().enumerate() {
                let axis = if k == coordinates { 2 } else { k };
                let index = self.index(op, register, k, lane, size[axis] - 1);
                outside |= index.clamped;
                at[axis] = index.at;
            }
            if outside {
                self.strayed.push(lane);
                continue;
            }
            let values = &ints[coordinates + usize::from(op.arrayed)..];
            let words = std::array::from_fn(|k| match (floats.get(k), values.get(k)) {
                (Some(&register), _) => A::float_word(self.floats.get(register)[lane]),
                (None, Some(&register)) => A::int_word(self.ints.get(register)[lane]),
                (None, None) => 0,
            });
            if let Some(words) = texture::stored(format, words) {
                texture.put(at, words);
                self.note_texel(op.texture, (lane, at), size, words, true);
            }
        }
    }

    /// Reports to the detector, if there is one, the texel that a lane accesses.
    fn note_texel(
        &mut self,
        texture: u32,
        (lane, at): (usize, [u32; 3]),
        size: [u32; 3],
        words: [u32; 4],
        writes: bool,
    ) {
        // The word is a hash of all channels, for comparisons (FNV-1a, by words).
        let word =
            words.iter().fold(0x811C_9DC5_u32, |all, word| (all ^ word).wrapping_mul(0x0100_0193));
        let Some(detector) = &mut self.detector else { return };
        if detector.watches_texture(texture) {
            let [x, y, z] = at.map(|k| k as usize);
            let index = (z * size[1] as usize + y) * size[0] as usize + x;
            let place = Place::Texel(at);
            let accessed = Accessed { lane, site: self.site, place, index, word };
            detector.texture(self.code, texture, accessed, (words, writes));
        }
    }

    fn uniform(&mut self, out: u32, word: u32) {
        self.ints.get_mut(out).fill(A::int(word, false));
    }

    /// Integer operand `k` of a lane, clamped to the range from 0 to `last`.
    fn index(&self, op: &ImageOp, register: u32, k: usize, lane: usize, last: u32) -> Index {
        let (lo, hi) = A::bounds(self.ints.get(register)[lane], op.signed >> k & 1 == 1);
        let clamped = lo < 0 || hi > i64::from(last);
        let elsewhere = self.elsewhere();
        let inside = |i: i64| elsewhere.find(i, i64::from(last)) as u32;
        Index { at: inside(lo), one: inside(lo) == inside(hi), clamped }
    }

    fn size(&mut self, op: &ImageOp, texture: &Texture, operands: &Operands<'_>) {
        for lane in 0..self.width {
            let mut level = 0;
            if let Some(&register) = operands.ints.first() {
                let index = self.index(op, register, 0, lane, texture.levels() - 1);
                level = index.at;
                // "If `level` is outside the range `[0, textureNumLevels(t))` then an indeterminate
                // value for the return type may be returned" (17.7.1).
                if index.clamped && A::possible(self.active()[lane]) {
                    self.leave(lane);
                }
            }
            let size = texture.level_size(level);
            for (&out, n) in operands.outs.iter().zip(size) {
                self.ints.get_mut(out)[lane] = A::int(n, false);
            }
        }
    }

    /// Finds the first coordinate or layer of a texel load that is outside of the texture. Returns this coordinate or
    /// layer, and the texture's size in this direction.
    pub(super) fn texel_beyond(
        &self,
        image: u32,
        registers: &[u32],
        lane: usize,
        memory: &Memory<'_, A>,
    ) -> Option<(i64, u64)> {
        let op = &self.code.images[image as usize];
        let ImageKind::Load { level, .. } = op.kind else { return None };
        let before = op.outs.iter().sum::<u32>() + op.ins[0];
        let ints = &registers[before as usize..][..op.ins[1] as usize];
        let texture = &memory.textures[op.texture as usize];
        let index = |k: usize| A::bounds(self.ints.get(ints[k])[lane], op.signed >> k & 1 == 1).0;
        let level = if level { index(ints.len() - 1) } else { 0 };
        let level = u32::try_from(level).ok().filter(|level| *level < texture.levels())?;
        let size = texture.level_size(level);
        let coordinates = op.coordinates as usize;
        let layer = op.arrayed.then_some((coordinates, size[2]));
        let mut all = (0..coordinates).map(|k| (k, size[k])).chain(layer);
        all.find_map(|(k, count)| {
            let at = index(k);
            (at < 0 || at >= i64::from(count)).then_some((at, u64::from(count)))
        })
    }

    fn load_texels(&mut self, op: &ImageOp, texture: &Texture, operands: &Operands<'_>) {
        let ImageKind::Load { level, sample, signed } = op.kind else { return };
        for lane in 0..self.width {
            // The operands have this order: coordinates, layer, sample, level.
            let n = operands.ints.len();
            let mut clamped = false;
            let mut one = true;
            let mut read = |k: usize, last: u32| {
                let index = self.index(op, operands.ints[k], k, lane, last);
                clamped |= index.clamped;
                one &= index.one;
                index.at
            };
            let level = if level { read(n - 1, texture.levels() - 1) } else { 0 };
            let size = texture.level_size(level);
            let mut at = [0; 3];
            let coordinates = op.coordinates as usize;
            for (k, at) in at.iter_mut().enumerate().take(coordinates) {
                *at = read(k, size[k] - 1);
            }
            if op.arrayed {
                at[2] = read(coordinates, size[2] - 1);
            }
            let sample = if sample {
                read(coordinates + usize::from(op.arrayed), texture.samples() - 1)
            } else {
                0
            };
            if clamped && A::possible(self.active()[lane]) {
                self.leave(lane);
            }
            let words = texture.texel(level, at, sample);
            if level == 0 && !clamped && self.acts(lane) {
                self.note_texel(op.texture, (lane, at), size, words, false);
            }
            for (channel, &out) in operands.outs.iter().enumerate() {
                if op.outs[0] > 0 {
                    let x = texture.channel::<A>(words[channel]);
                    let x = if one { x } else { A::filtered(0.0, texture.hull(channel)) };
                    self.floats.get_mut(out)[lane] = x;
                } else {
                    let x = A::int(words[channel], signed);
                    let x = if one { x } else { A::unknown_int(signed).unwrap_or(x) };
                    self.ints.get_mut(out)[lane] = x;
                }
            }
        }
    }

    fn sample(
        &mut self,
        op: &ImageOp,
        texture: &Texture,
        sampler: &Sampler,
        operands: &Operands<'_>,
    ) {
        let ImageKind::Sample { detail, compare, gather, clamp } = op.kind else { return };
        let coordinates = op.coordinates as usize;
        let plain = !A::NOTES && gather.is_none() && !compare && !clamp && operands.ints.is_empty();
        if plain && texture.is_bilinear(sampler) {
            self.sample_together(
                (texture, sampler),
                &operands.floats[..coordinates],
                operands.outs,
            );
            return;
        }
        for lane in 0..self.width {
            // In the last iterations of a loop, few lanes are active. A sample takes much time, so inactive lanes are
            // skipped.
            if !A::possible(self.active()[lane]) {
                continue;
            }
            let float = |k: usize| {
                operands.floats.get(k).map_or(0.0, |&r| A::coordinate(self.floats.get(r)[lane]))
            };
            let vector = |start: usize| {
                let mut vector = [0.0; 3];
                for (k, to) in vector.iter_mut().enumerate().take(coordinates) {
                    *to = float(start + k);
                }
                vector
            };
            let mut place = texture::Place { at: vector(0), layer: 0, offset: [0; 3] };
            if clamp {
                for k in 0..coordinates {
                    let half = 0.5 / f64::from(texture.size()[k]);
                    place.at[k] = place.at[k].clamp(half, 1.0 - half);
                }
            }
            let mut next_int = 0;
            if op.arrayed {
                let faces = if texture.dimension() == Dimension::Cube { 6 } else { 1 };
                let last = (texture.size()[2] / faces).saturating_sub(1);
                let index = self.index(op, operands.ints[0], 0, lane, last);
                place.layer = index.at;
                next_int = 1;
                if index.clamped && A::possible(self.active()[lane]) {
                    self.strayed.push(lane);
                }
            }
            for (k, &register) in operands.ints[next_int..].iter().enumerate().take(3) {
                let (offset, _) = A::bounds(self.ints.get(register)[lane], true);
                place.offset[k] = offset as i32;
            }
            let after = coordinates + usize::from(compare);
            let reference = if compare { Some(float(coordinates)) } else { None };
            let level = match detail {
                Detail::Zero => Level::Exact(0.0),
                Detail::Exact => Level::Exact(float(after)),
                Detail::Gradient => Level::Gradient(vector(after), vector(after + coordinates)),
            };
            let unbounded = A::NOTES
                && operands
                    .floats
                    .iter()
                    .any(|&r| A::coordinate(self.floats.get(r)[lane]).is_nan());
            if let Some(channel) = gather {
                let channel = channel as usize;
                for (k, footprint) in texture.gathered(sampler, place).into_iter().enumerate() {
                    if op.outs[0] > 0 {
                        let mut mean = Mean::of(sampler, reference);
                        for &(weight, at) in &footprint {
                            mean.add(weight, texture.texel(0, at, 0));
                        }
                        let x = mean.channel::<A>(texture, channel, unbounded);
                        self.floats.get_mut(operands.outs[k])[lane] = x;
                    } else {
                        let word = footprint
                            .first()
                            .map_or(0, |&(_, at)| texture.texel(0, at, 0)[channel]);
                        self.ints.get_mut(operands.outs[k])[lane] = A::int(word, op.signed_texels);
                    }
                }
                continue;
            }
            // Intervals include all texels, so the coordinates don't matter.
            let mean = match A::NOTES {
                true => Mean::of(sampler, reference),
                false => texture.mean(sampler, place, level, reference),
            };
            for (channel, &out) in operands.outs.iter().enumerate() {
                let x = mean.channel::<A>(texture, channel, unbounded);
                self.floats.get_mut(out)[lane] = x;
            }
        }
    }
}

impl<A: Rules> Machine<'_, A> {
    fn sample_together(
        &mut self,
        (texture, sampler): (&Texture, &Sampler),
        coordinates: &[u32],
        outs: &[u32],
    ) {
        for from in (0..self.width).step_by(TOGETHER) {
            let lanes = from..self.width.min(from + TOGETHER);
            let mut wanted = [false; TOGETHER];
            for (wanted, mask) in wanted.iter_mut().zip(&self.active()[lanes.clone()]) {
                *wanted = A::possible(*mask);
            }
            // In the last iterations of a loop, few lanes are active.
            if !wanted.contains(&true) {
                continue;
            }
            let mut at: [Many; 3] = [[0.0; TOGETHER]; 3];
            for (at, &register) in at.iter_mut().zip(coordinates) {
                let column = &self.floats.get(register)[lanes.clone()];
                at.iter_mut().zip(column).for_each(|(at, x)| *at = A::coordinate(*x));
            }
            let (sums, left_out) = texture.bilinear_of(&at, &wanted);
            for (channel, &out) in outs.iter().enumerate() {
                let hull = texture.hull(channel);
                let column = &mut self.floats.get_mut(out)[lanes.clone()];
                // The values of inactive lanes have no meaning.
                column
                    .iter_mut()
                    .zip(&sums)
                    .for_each(|(to, sum)| *to = A::filtered(sum[channel], hull));
            }
            for k in (0..lanes.len()).filter(|k| left_out[*k]) {
                let place = texture::Place { at: at.map(|at| at[k]), layer: 0, offset: [0; 3] };
                let mean = texture.mean(sampler, place, Level::Exact(0.0), None);
                for (channel, &out) in outs.iter().enumerate() {
                    let x = mean.channel::<A>(texture, channel, false);
                    self.floats.get_mut(out)[from + k] = x;
                }
            }
        }
    }
}

struct Index {
    at: u32,
    one: bool,
    clamped: bool,
}
