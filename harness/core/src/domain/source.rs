//! The random numbers of one case.

use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;

/// The random numbers of one case. The seed and the case's index determine these numbers.
///
/// ```
/// use karat::unstable::domain::Source;
///
/// // A case always gets the same numbers.
/// assert_eq!(Source::new(7, 3).bits(), Source::new(7, 3).bits());
/// ```
#[derive(Clone, Debug)]
pub struct Source(Pcg32);

/// 2^64 divided by the golden ratio. A multiplication by this number spreads consecutive indices over all bits of the
/// state.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

impl Source {
    /// The random numbers of case `index` with this seed.
    ///
    /// ```
    /// use karat::unstable::domain::Source;
    ///
    /// assert_ne!(Source::new(7, 3).bits(), Source::new(7, 4).bits());
    /// ```
    #[inline]
    #[must_use]
    pub fn new(seed: u64, index: u64) -> Self {
        Self(Pcg32::new(seed ^ index.wrapping_mul(GOLDEN), index))
    }

    /// 32 random bits.
    ///
    /// ```
    /// use karat::unstable::domain::Source;
    ///
    /// let seed: u32 = Source::new(7, 0).bits();
    /// # let _ = seed;
    /// ```
    #[inline]
    pub fn bits(&mut self) -> u32 {
        self.0.next_u32()
    }

    /// A uniform number in `[0, 1)`. It is a multiple of 2^-32.
    ///
    /// ```
    /// use karat::unstable::domain::Source;
    ///
    /// assert!((0.0..1.0).contains(&Source::new(7, 0).unit()));
    /// ```
    #[inline]
    pub fn unit(&mut self) -> f64 {
        unit(self.bits())
    }

    /// A uniform integer in `0..count`. It is 0 if `count` is 0.
    ///
    /// ```
    /// use karat::unstable::domain::Source;
    ///
    /// let die = 1 + Source::new(7, 0).below(6);
    /// assert!((1..=6).contains(&die));
    /// ```
    #[inline]
    pub fn below(&mut self, count: u64) -> u64 {
        let bits = u128::from(self.0.next_u64());
        let scaled = (bits * u128::from(count)) >> 64;
        u64::try_from(scaled).expect("a 64-bit fraction of a u64 is a u64")
    }

    /// A distance from 2^-24 to 1 with an approximately uniform logarithm. Use it for points close to an edge, down to
    /// the last bit of an `f32` near 1.
    ///
    /// ```
    /// use karat::unstable::domain::Source;
    ///
    /// // The point is close to the pole, often very close.
    /// let z = 1.0 - Source::new(7, 0).log_distance();
    /// assert!(z < 1.0);
    /// ```
    pub fn log_distance(&mut self) -> f64 {
        log_distance(self.bits())
    }
}

#[inline]
pub(super) fn unit(bits: u32) -> f64 {
    f64::from(bits) / 4_294_967_296.0
}

/// Computes the number that [`Source::log_distance`] returns. The function chooses a random binade, then a position in
/// it. This is faster than an exponential function, and precise enough here.
#[inline]
pub(super) fn log_distance(bits: u32) -> f64 {
    // An `f64` stores its exponent plus 1023, so this number is 2^-binade.
    let binade = f64::from_bits(u64::from(1023 - bits % 24) << 52);
    (0.5 + 0.5 * f64::from(bits >> 5) / f64::from(1_u32 << 27)) * binade
}
