//! Compiles the interpreter in this crate, once for each arithmetic, so that other crates needn't compile this generic
//! code.

use crate::arithmetic::{Arithmetic, F32, F64, Intervals};
use crate::observer::Observer;
use crate::options::Options;
use crate::program::{Call, Program};
use crate::refusal::Stop;
use crate::resources::Resources;
use crate::results::Results;

/// An arithmetic in which programs can run. The trait is sealed, like [`Arithmetic`].
pub trait Runs: Arithmetic {
    /// Implements [`Program::call`] in this arithmetic.
    #[doc(hidden)]
    fn call(
        program: &Program,
        call: &Call<'_>,
        observer: &dyn Observer<Self>,
    ) -> Result<Results<Self>, Stop>;

    /// Implements [`Program::dispatch`] in this arithmetic.
    #[doc(hidden)]
    fn dispatch(
        program: &Program,
        workgroups: [u32; 3],
        resources: &mut Resources,
        options: &Options,
        observer: &dyn Observer<Self>,
    ) -> Result<(), Stop>;
}

macro_rules! runs {
    ($($arithmetic:ty),*) => {
        $(impl Runs for $arithmetic {
            fn call(
                program: &Program,
                call: &Call<'_>,
                observer: &dyn Observer<Self>,
            ) -> Result<Results<Self>, Stop> {
                match observer.is_active() {
                    true => program.run::<Self, true>(call, observer),
                    false => program.run::<Self, false>(call, observer),
                }
            }

            fn dispatch(
                program: &Program,
                workgroups: [u32; 3],
                resources: &mut Resources,
                options: &Options,
                observer: &dyn Observer<Self>,
            ) -> Result<(), Stop> {
                let run = match observer.is_active() {
                    true => Program::run_workgroups::<Self, true>,
                    false => Program::run_workgroups::<Self, false>,
                };
                run(program, workgroups, resources, options, observer, None).map(drop)
            }
        })*
    };
}

runs!(F32, F64, Intervals);
