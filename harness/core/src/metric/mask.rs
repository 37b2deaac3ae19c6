//! Masks: the pixels of a frame that are compared.

use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::diagnostic::FileRead;
use crate::image::{ExrFile, Image};

/// The name of the part with the mask in a frame's OpenEXR file: 1 for compared pixels, and 0 for all others.
pub const MASK: &str = "mask";

/// A rectangle of pixels.
///
/// ```
/// use karat::metric::Rect;
///
/// let corner = Rect::new(0, 0, 16, 8);
/// assert!(corner.contains(15, 7) && !corner.contains(16, 7));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rect {
    /// The first column.
    pub left: u32,
    /// The first row.
    pub top: u32,
    /// The number of columns.
    pub width: u32,
    /// The number of rows.
    pub height: u32,
}

impl ExrFile {
    /// The mask of the test that drew this frame or golden. `None` if the test declared no mask. Karat stores the mask
    /// as the file's part `mask`.
    ///
    /// ```no_run
    /// use karat::unstable::image::ExrFile;
    ///
    /// let golden = ExrFile::read("golden/dusk.exr".as_ref())?;
    /// println!("all pixels are compared: {}", golden.mask().is_none());
    /// # Ok::<(), karat::image::ImageError>(())
    /// ```
    #[must_use]
    pub fn mask(&self) -> Option<Mask> {
        let part = self.parts.iter().skip(1).find(|part| part.name == MASK)?;
        Some(Mask::image(part.image.clone()))
    }
}

impl Rect {
    /// A rectangle from its first column and row, and its size in pixels.
    ///
    /// ```
    /// use karat::metric::Rect;
    ///
    /// assert_eq!(Rect::new(4, 2, 16, 8).left, 4);
    /// ```
    #[must_use]
    pub const fn new(left: u32, top: u32, width: u32, height: u32) -> Self {
        Self { left, top, width, height }
    }

    /// Checks if a pixel is in the rectangle.
    ///
    /// ```
    /// use karat::metric::Rect;
    ///
    /// assert!(Rect::new(4, 2, 16, 8).contains(4, 2));
    /// ```
    #[must_use]
    pub fn contains(&self, x: u32, y: u32) -> bool {
        x.wrapping_sub(self.left) < self.width && y.wrapping_sub(self.top) < self.height
    }

    /// Checks if the rectangle isn't empty, and is completely inside of an image of this size.
    #[doc(hidden)]
    pub fn fits(&self, width: u32, height: u32) -> bool {
        let inside = |start: u32, length: u32, side: u32| {
            length > 0 && start.checked_add(length).is_some_and(|end| end <= side)
        };
        inside(self.left, self.width, width) && inside(self.top, self.height, height)
    }

    /// The rectangle from the pixel at `left`, `top` to the pixel at `right`, `bottom`, including both.
    #[doc(hidden)]
    pub fn spanning([left, top, right, bottom]: [u32; 4]) -> Self {
        Self { left, top, width: right - left + 1, height: bottom - top + 1 }
    }

    /// The rectangle, extended by `reach` pixels on each side, but not beyond an image of this size.
    #[doc(hidden)]
    pub fn grown(&self, reach: u32, width: u32, height: u32) -> Self {
        let (left, top) = (self.left.saturating_sub(reach), self.top.saturating_sub(reach));
        let right = (self.left + self.width).saturating_add(reach).min(width);
        let bottom = (self.top + self.height).saturating_add(reach).min(height);
        Self { left, top, width: right - left, height: bottom - top }
    }
}

/// Writes the coordinates of the first and the last pixel: `(3, 4) to (10, 12)`.
impl fmt::Display for Rect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let last = |start: u32, length: u32| start + length.max(1) - 1;
        let (right, bottom) = (last(self.left, self.width), last(self.top, self.height));
        write!(f, "({}, {}) to ({right}, {bottom})", self.left, self.top)
    }
}

/// The pixels of a frame that are compared. Metrics ignore all other pixels.
///
/// ```
/// use karat::metric::{Mask, Rect};
///
/// let without_the_clock = Mask::except(&[Rect::new(48, 0, 16, 8)]);
/// let image = without_the_clock.to_image(64, 64)?;
/// assert_eq!(image.pixels()[63][0], 0.0);
/// # Ok::<(), karat::metric::MaskError>(())
/// ```
#[derive(Clone)]
pub struct Mask(Kind);

#[derive(Clone)]
enum Kind {
    Image(Image),
    Only(Vec<Rect>),
    Except(Vec<Rect>),
    Where(Arc<dyn Fn(u32, u32) -> bool + Send + Sync>),
}

impl Mask {
    /// A mask that compares the pixels for which the red channel of `image` is above 0.5. The image must have the
    /// frame's size. Read a painted mask with [`Image::read_stored`].
    ///
    /// ```
    /// use karat::Image;
    /// use karat::metric::Mask;
    ///
    /// let left = Mask::image(Image::new(2, 1, vec![[1.0; 4], [0.0; 4]]));
    /// # let _ = left;
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn image(image: Image) -> Self {
        Self(Kind::Image(image))
    }

    /// A mask that compares only the pixels in these rectangles.
    ///
    /// ```
    /// use karat::metric::{Mask, Rect};
    ///
    /// let image = Mask::only(&[Rect::new(0, 0, 1, 1)]).to_image(2, 1)?;
    /// assert_eq!((image.pixels()[0][0], image.pixels()[1][0]), (1.0, 0.0));
    /// # Ok::<(), karat::metric::MaskError>(())
    /// ```
    #[must_use]
    pub fn only(rects: &[Rect]) -> Self {
        Self(Kind::Only(rects.to_vec()))
    }

    /// A mask that compares all pixels except those in these rectangles.
    ///
    /// ```
    /// use karat::metric::{Mask, Rect};
    ///
    /// let image = Mask::except(&[Rect::new(0, 0, 1, 1)]).to_image(2, 1)?;
    /// assert_eq!((image.pixels()[0][0], image.pixels()[1][0]), (0.0, 1.0));
    /// # Ok::<(), karat::metric::MaskError>(())
    /// ```
    #[must_use]
    pub fn except(rects: &[Rect]) -> Self {
        Self(Kind::Except(rects.to_vec()))
    }

    /// A mask that compares the pixels for which `compared`, a function of the column and the row, returns `true`.
    ///
    /// ```
    /// use karat::metric::Mask;
    ///
    /// let upper_half = Mask::wherever(|_, y| y < 32);
    /// # let _ = upper_half;
    /// ```
    #[must_use]
    pub fn wherever(compared: impl Fn(u32, u32) -> bool + Send + Sync + 'static) -> Self {
        Self(Kind::Where(Arc::new(compared)))
    }

    /// The file from which the mask's image was read, if the mask is an image.
    #[doc(hidden)]
    pub fn origin(&self) -> Option<&FileRead> {
        match &self.0 {
            Kind::Image(image) => image.origin(),
            _ => None,
        }
    }

    /// The mask as an image for a frame of this size: 1 for compared pixels, and 0 for all others.
    ///
    /// ```
    /// use karat::metric::Mask;
    ///
    /// let diagonal = Mask::wherever(|x, y| x == y).to_image(2, 2)?;
    /// assert_eq!(diagonal.pixels().iter().filter(|pixel| pixel[0] == 1.0).count(), 2);
    /// # Ok::<(), karat::metric::MaskError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the mask can't be used for a frame of this size, or if the mask excludes all pixels.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn to_image(&self, width: u32, height: u32) -> Result<Image, MaskError> {
        let value = |compared: bool| if compared { 1.0 } else { 0.0 };
        let flags = self.flags(width, height)?.into_iter().map(value);
        Ok(Image::new(width, height, flags.map(|value| [value, value, value, 1.0]).collect()))
    }

    /// The mask as one flag for each pixel of a frame of this size: `true` if metrics compare the pixel.
    pub(super) fn flags(&self, width: u32, height: u32) -> Result<Vec<bool>, MaskError> {
        let rects: &[Rect] = match &self.0 {
            Kind::Only(rects) | Kind::Except(rects) => rects,
            Kind::Image(_) | Kind::Where(_) => &[],
        };
        if let Some(rect) = rects.iter().find(|rect| !rect.fits(width, height)) {
            return Err(MaskError::Outside { rect: *rect, width, height });
        }
        let every = |compared: &dyn Fn(u32, u32) -> bool| {
            let rows = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
            rows.map(|(x, y)| compared(x, y)).collect::<Vec<_>>()
        };
        let flags = match &self.0 {
            Kind::Image(image) if (image.width(), image.height()) != (width, height) => {
                let mask = (image.width(), image.height());
                return Err(MaskError::Size { mask, frame: (width, height) });
            }
            Kind::Image(image) => {
                let unclear = image.pixels().iter().position(|pixel| !pixel[0].is_finite());
                if let Some(index) = unclear {
                    let (x, y) = (index % width as usize, index / width as usize);
                    return Err(MaskError::NonFinite { x, y });
                }
                image.pixels().iter().map(|pixel| pixel[0] > 0.5).collect()
            }
            Kind::Only(rects) => every(&|x, y| rects.iter().any(|rect| rect.contains(x, y))),
            Kind::Except(rects) => every(&|x, y| !rects.iter().any(|rect| rect.contains(x, y))),
            Kind::Where(compared) => every(&|x, y| compared(x, y)),
        };
        if flags.contains(&true) { Ok(flags) } else { Err(MaskError::Nothing) }
    }
}

impl fmt::Debug for Mask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Kind::Image(image) => write!(f, "Mask::image({} x {})", image.width(), image.height()),
            Kind::Only(rects) => f.debug_tuple("Mask::only").field(rects).finish(),
            Kind::Except(rects) => f.debug_tuple("Mask::except").field(rects).finish(),
            Kind::Where(_) => f.write_str("Mask::wherever(..)"),
        }
    }
}

/// The reason why a mask can't be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MaskError {
    /// The red channel of the mask's image has a NaN or an infinity.
    #[error("the mask has a NaN or an infinity at ({x}, {y})")]
    NonFinite {
        /// The column of the pixel.
        x: usize,
        /// The row of the pixel.
        y: usize,
    },
    /// The mask excludes all pixels.
    #[error("the mask excludes all pixels")]
    Nothing,
    /// The mask's image has another size than the frame.
    #[error("the mask has {} x {} pixels, but the frame has {} x {}", mask.0, mask.1, frame.0, frame.1)]
    Size {
        /// Width and height of the mask.
        mask: (u32, u32),
        /// Width and height of the frame.
        frame: (u32, u32),
    },
    /// A rectangle of the mask is empty, or extends beyond the frame.
    #[error(
        "the mask's rectangle {rect} is empty or extends beyond the frame of {width} x {height} pixels"
    )]
    Outside {
        /// The rectangle.
        rect: Rect,
        /// Width of the frame.
        width: u32,
        /// Height of the frame.
        height: u32,
    },
}
