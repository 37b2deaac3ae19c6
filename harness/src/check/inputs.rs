//! The ways to pass arguments to the function, such as a storage buffer or constants. If a check selects several ways,
//! Karat runs the check once for each way, and gives one verdict.

use super::{Calls, Check, Plan};
use crate::probe::Inputs;
use crate::run::Identity;

impl<V> Check<'_, Calls<V>> {
    /// Chooses how the kernel gets the function's arguments. The default is a storage buffer.
    ///
    /// With [constants](Inputs::Constant), Karat checks at most 64 cases. If the domain has at most 64 values,
    /// Karat checks all of them. Otherwise half of the cases are edges.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// let half = package.function("half").over(0.0..=1.0);
    /// half.inputs(Inputs::Uniform).agrees_with(|x: f64| 0.5 * x, Ulp(0.0));
    /// ```
    pub fn inputs(mut self, inputs: Inputs) -> Self {
        self.plan.probe.inputs = vec![inputs];
        self
    }

    /// Makes the check run once for each way to pass arguments, because compilers treat the ways differently (see
    /// [`Inputs`]).
    /// The check's record has a result for each way on each path.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS.function("sensor::srgb_from_linear")
    ///     .over(0.0..=1.0)
    ///     .from_all_sources()
    ///     .satisfies("is a fraction", |_, x: f32| (0.0..=1.0).contains(&x));
    /// ```
    pub fn from_all_sources(mut self) -> Self {
        self.plan.probe.inputs = Inputs::ALL.to_vec();
        self
    }
}

/// Returns the ways in which the check passes arguments. If a replay names one of these ways, returns only that
/// way.
pub(super) fn chosen(plan: &Plan<'_>, identity: &Identity) -> Vec<Inputs> {
    let asked = match &*plan.probe.inputs {
        [] => &[Inputs::Storage],
        asked => asked,
    };
    let replayed = identity.inputs(&plan.probe.name, &identity.check);
    let replayed = replayed.filter(|inputs| asked.contains(inputs));
    let chosen = asked.iter().copied();
    chosen.filter(|inputs| replayed.is_none_or(|replayed| replayed == *inputs)).collect()
}
