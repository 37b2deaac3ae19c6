//! Lowers operations on textures.

use naga::{
    DerivativeAxis, Expression, Handle, ImageClass, ImageDimension, ImageQuery, SampleLevel,
    ScalarKind, Statement, TypeInner,
};

use super::{Lower, Lowered, Scope, Value};
use crate::code::{Detail, ImageKind, ImageOp, Op, Reg};
use crate::rules::{Basic, Exponential, FloatRule, FromInt};
use crate::scalar::File;

struct Image {
    slot: u32,
    dimension: ImageDimension,
    arrayed: bool,
    class: ImageClass,
}

impl Image {
    fn coordinates(&self) -> u32 {
        match self.dimension {
            ImageDimension::D1 => 1,
            ImageDimension::D2 => 2,
            ImageDimension::D3 | ImageDimension::Cube => 3,
        }
    }

    fn kind(&self) -> ScalarKind {
        match self.class {
            ImageClass::Sampled { kind, .. } => kind,
            ImageClass::Depth { .. } | ImageClass::External => ScalarKind::Float,
            ImageClass::Storage { format, .. } => naga::Scalar::from(format).kind,
        }
    }
}

impl<'m> Lower<'m> {
    fn texture(&mut self, scope: &mut Scope<'m>, handle: Handle<Expression>) -> Lowered<Image> {
        let Value::Texture(slot, ty) = self.value(scope, handle)? else {
            return Err(self.refuse("a texture that isn't a variable"));
        };
        match *self.layouts.inner(ty) {
            TypeInner::Image { class: ImageClass::External, .. } => {
                Err(self.refuse("external textures"))
            }
            TypeInner::Image { dim, arrayed, class } => {
                Ok(Image { slot, dimension: dim, arrayed, class })
            }
            _ => Err(self.refuse("a texture of an unknown type")),
        }
    }

    /// Appends integer operands, and notes which of them are signed.
    fn indices(
        &mut self,
        scope: &mut Scope<'m>,
        handle: Handle<Expression>,
        ints: &mut Vec<Reg>,
        signed: &mut u32,
    ) -> Lowered<()> {
        let is_signed = self.signed(scope, handle);
        for register in self.flat(scope, handle)?.iter() {
            if register.file != File::Int {
                return Err(self.refuse("a texture index that isn't an integer"));
            }
            *signed |= u32::from(is_signed) << ints.len();
            ints.push(*register);
        }
        Ok(())
    }

    pub(super) fn image(
        &mut self,
        scope: &mut Scope<'m>,
        handle: Handle<Expression>,
    ) -> Lowered<Value> {
        let (site, span) = (self.site, self.span);
        let (mut floats, mut ints, mut signed) = (Vec::new(), Vec::new(), 0);
        let (texture, sampler, kind) = match scope.expressions[handle] {
            Expression::ImageSample {
                image,
                sampler,
                gather,
                coordinate,
                array_index,
                offset,
                level,
                depth_ref,
                clamp_to_edge,
            } => {
                let texture = self.texture(scope, image)?;
                let Value::Sampler(sampler) = self.value(scope, sampler)? else {
                    return Err(self.refuse("a sampler that isn't a variable"));
                };
                floats.extend_from_slice(&self.flat(scope, coordinate)?);
                if let Some(index) = array_index {
                    self.indices(scope, index, &mut ints, &mut signed)?;
                }
                if let Some(reference) = depth_ref {
                    floats.extend_from_slice(&self.flat(scope, reference)?);
                }
                if let Some(offset) = offset {
                    self.indices(scope, offset, &mut ints, &mut signed)?;
                }
                let detail = match level {
                    SampleLevel::Zero => Detail::Zero,
                    SampleLevel::Exact(level) => {
                        let level = self.level(scope, level)?;
                        floats.push(level);
                        Detail::Exact
                    }
                    SampleLevel::Gradient { x, y } => {
                        floats.extend_from_slice(&self.flat(scope, x)?);
                        floats.extend_from_slice(&self.flat(scope, y)?);
                        Detail::Gradient
                    }
                    SampleLevel::Auto if gather.is_some() => Detail::Zero,
                    SampleLevel::Auto | SampleLevel::Bias(_) => {
                        // The level is a logarithm, so the bias must be added to it.
                        let scale = match level {
                            SampleLevel::Bias(bias) => {
                                let bias = self.flat(scope, bias)?[0];
                                let exp2 = FloatRule::Exponential(Exponential::Exp2);
                                Some(self.float_op(exp2, &[bias], false)?)
                            }
                            _ => None,
                        };
                        let at = self.flat(scope, coordinate)?;
                        (self.site, self.span) = (site, span);
                        for axis in [DerivativeAxis::X, DerivativeAxis::Y] {
                            for register in at.iter() {
                                let mut change = self.derivative(axis, *register, false)?;
                                if let Some(scale) = scale {
                                    change =
                                        self.basic(Basic::Multiply, &[change, scale], false)?;
                                }
                                floats.push(change);
                            }
                        }
                        Detail::Gradient
                    }
                };
                let gather = gather.map(|channel| channel.index() as u8);
                let compare = depth_ref.is_some();
                let kind = ImageKind::Sample { detail, compare, gather, clamp: clamp_to_edge };
                (texture, sampler, kind)
            }
            Expression::ImageLoad { image, coordinate, array_index, sample, level } => {
                let texture = self.texture(scope, image)?;
                let parts = [Some(coordinate), array_index, sample, level];
                for part in parts.into_iter().flatten() {
                    self.indices(scope, part, &mut ints, &mut signed)?;
                }
                let is_signed = texture.kind() == ScalarKind::Sint;
                let (level, sample) = (level.is_some(), sample.is_some());
                (texture, u32::MAX, ImageKind::Load { level, sample, signed: is_signed })
            }
            Expression::ImageQuery { image, query } => {
                let texture = self.texture(scope, image)?;
                let kind = match query {
                    ImageQuery::Size { level } => {
                        if let Some(level) = level {
                            self.indices(scope, level, &mut ints, &mut signed)?;
                        }
                        ImageKind::Size
                    }
                    ImageQuery::NumLevels => ImageKind::Levels,
                    ImageQuery::NumLayers => ImageKind::Layers,
                    ImageQuery::NumSamples => ImageKind::Samples,
                };
                (texture, u32::MAX, kind)
            }
            _ => return Err(self.refuse("this operation on a texture")),
        };
        (self.site, self.span) = (site, span);
        let scalars = self.scalars(&self.type_of(scope, handle))?;
        let outs: Vec<Reg> = scalars.iter().map(|scalar| self.fresh(scalar.file())).collect();
        let file = scalars.first().map_or(File::Int, |scalar| scalar.file());
        let mut counts = [0; 3];
        counts[file as usize] = outs.len() as u32;
        self.code.images.push(ImageOp {
            texture: texture.slot,
            sampler,
            kind,
            coordinates: texture.coordinates(),
            arrayed: texture.arrayed,
            signed,
            signed_texels: texture.kind() == ScalarKind::Sint,
            outs: counts,
            ins: [floats.len() as u32, ints.len() as u32, 0],
        });
        let op = Op::Image(self.code.images.len() as u32 - 1);
        self.emit(op, &outs, &[floats, ints].concat())?;
        Ok(Value::Flat(outs.into()))
    }

    /// A level of detail as a float. Lowering converts the levels of depth textures, which are integers.
    fn level(&mut self, scope: &mut Scope<'m>, level: Handle<Expression>) -> Lowered<Reg> {
        let signed = self.signed(scope, level);
        let register = self.flat(scope, level)?[0];
        if register.file == File::Float {
            return Ok(register);
        }
        let rule = if signed { FromInt::Signed } else { FromInt::Unsigned };
        Ok(self.floats_of(rule, register)?[0])
    }

    pub(super) fn image_store(
        &mut self,
        scope: &mut Scope<'m>,
        statement: &'m Statement,
        span: naga::Span,
    ) -> Lowered<()> {
        self.span = span;
        let Statement::ImageStore { image, coordinate, array_index, value } = *statement else {
            return Err(self.refuse("this statement on a texture"));
        };
        let texture = self.texture(scope, image)?;
        let ImageClass::Storage { format, .. } = texture.class else {
            return Err(self.refuse("writes to a texture that isn't a storage texture"));
        };
        if !self.shared {
            return Err(self.refuse(
                "a function that writes a texture, because all cases would share the texture",
            ));
        }
        if !is_storable(format) {
            return Err(self.refuse(format!("writes to textures of format {format:?}")));
        }
        let (mut ints, mut signed) = (Vec::new(), 0);
        for part in [Some(coordinate), array_index].into_iter().flatten() {
            self.indices(scope, part, &mut ints, &mut signed)?;
        }
        let value = self.flat(scope, value)?;
        self.span = span;
        let floats = value.iter().filter(|register| register.file == File::Float).count() as u32;
        let operands = if floats > 0 {
            [&value[..], &ints[..]].concat()
        } else {
            [&ints[..], &value[..]].concat()
        };
        self.code.textures[texture.slot as usize].written = true;
        self.code.images.push(ImageOp {
            texture: texture.slot,
            sampler: u32::MAX,
            kind: ImageKind::Store(format),
            coordinates: texture.coordinates(),
            arrayed: texture.arrayed,
            signed,
            signed_texels: texture.kind() == ScalarKind::Sint,
            outs: [0; 3],
            ins: [floats, operands.len() as u32 - floats, 0],
        });
        self.enter_statement(scope, span);
        let op = Op::ImageStore(self.code.images.len() as u32 - 1);
        self.emit(op, &[], &operands)?;
        Ok(())
    }
}

fn is_storable(format: naga::StorageFormat) -> bool {
    crate::texture::stored(format, [0; 4]).is_some()
}
