//! Catches panics that shaders cause in compilers, such as naga. The caller gets the message, and stderr gets nothing.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Once;

/// A panic that was caught.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Panicked {
    /// The panic's message.
    pub message: String,
    /// The file and line of the panic: `naga-30.0.1/src/back/glsl/writer.rs:2120`. Empty if unknown.
    pub place: String,
}

impl Panicked {
    /// The language that naga was writing when it panicked.
    #[must_use]
    pub fn language(&self) -> Option<&'static str> {
        let (krate, behind) = self.place.split_once("/src/back/")?;
        let known = [
            ("glsl", "GLSL"),
            ("hlsl", "HLSL"),
            ("msl", "MSL"),
            ("spv", "SPIR-V"),
            ("wgsl", "WGSL"),
        ];
        let folder = behind.split('/').next()?;
        let is_own = |one: &&(&str, &str)| krate.contains("naga") && one.0 == folder;
        known.iter().find(is_own).map(|(_, language)| *language)
    }
}

impl fmt::Display for Panicked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(language) = self.language() {
            write!(f, "naga panics as it writes {language}: ")?;
        }
        f.write_str(&self.message)?;
        match &*self.place {
            "" => Ok(()),
            place => write!(f, " (panicked at {place})"),
        }
    }
}

thread_local! {
    /// `true` while [`caught`] runs code on this thread.
    static CAUGHT: Cell<bool> = const { Cell::new(false) };
    static PLACE: RefCell<String> = const { RefCell::new(String::new()) };
}

/// The payload of a panic inside of [`passing`]. [`caught`] passes such a panic on instead of catching it.
struct Passing(Box<dyn Any + Send>);

/// Runs `work`, and catches its panic.
///
/// # Errors
/// Returns an error if `work` panics.
pub fn caught<T>(work: impl FnOnce() -> T) -> Result<T, Panicked> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| match CAUGHT.get() {
            true => PLACE
                .set(panic.location().map(|at| short(at.file(), at.line())).unwrap_or_default()),
            false => usual(panic),
        }));
    });
    let before = CAUGHT.replace(true);
    let done = catch_unwind(AssertUnwindSafe(work));
    CAUGHT.set(before);
    let payload = match done {
        Ok(value) => return Ok(value),
        Err(payload) => payload,
    };
    // This panic came from a helper thread, which has already caught it.
    let payload = match payload.downcast::<Panicked>() {
        Ok(panicked) => return Err(*panicked),
        Err(payload) => payload,
    };
    match payload.downcast::<Passing>() {
        Ok(passing) if before => resume_unwind(passing),
        Ok(passing) => resume_unwind(passing.0),
        Err(payload) => {
            let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
            let message = text.or_else(|| payload.downcast_ref::<String>().cloned());
            Err(Panicked { message: message.unwrap_or_default(), place: PLACE.take() })
        }
    }
}

/// Runs `work`, such as a closure of a test, so that [`caught`] doesn't catch its panics. A panic of `work` reaches the
/// caller of [`caught`] with its usual message.
pub fn passing<T>(work: impl FnOnce() -> T) -> T {
    if !CAUGHT.replace(false) {
        return work();
    }
    let done = catch_unwind(AssertUnwindSafe(work));
    CAUGHT.set(true);
    done.unwrap_or_else(|payload| resume_unwind(Box::new(Passing(payload))))
}

/// Checks if this thread runs code inside of [`caught`]. If other threads do a part of this thread's work, they pass
/// this result to [`helping`].
#[must_use]
pub fn are_caught() -> bool {
    CAUGHT.get()
}

/// Runs a part of another thread's work. `caught` is the result of [`are_caught`] in that thread. If it is `true`, a
/// panic isn't written to stderr, and goes to that thread's [`caught`].
pub fn helping<T>(caught: bool, work: impl FnOnce() -> T) -> T {
    match caught {
        true => self::caught(work).unwrap_or_else(|panicked| resume_unwind(Box::new(panicked))),
        false => work(),
    }
}

/// The file and line of a panic as text, without the folder in which cargo stores crates.
fn short(file: &str, line: u32) -> String {
    let file = file.replace('\\', "/");
    let behind = file.split_once("/registry/src/").and_then(|(_, own)| own.split_once('/'));
    format!("{}:{line}", behind.map_or(&*file, |(_, own)| own))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_caught_panic_has_its_message_and_place() {
        let panicked = caught(|| panic!("no {}", "way")).expect_err("it panics");
        assert_eq!(panicked.message, "no way");
        assert!(panicked.place.contains("panics.rs:"), "{panicked}");
        assert_eq!(caught(|| 3), Ok(3));
        assert!(!are_caught(), "later panics must not be caught");
        let inner = caught(|| caught(|| panic!("inner")).is_err() && are_caught());
        assert_eq!(inner, Ok(true));
    }

    #[test]
    fn a_panic_of_the_callers_code_is_not_caught() {
        let own = catch_unwind(|| caught(|| caught(|| passing(|| panic!("own")))));
        let payload = own.expect_err("the panic passes");
        assert_eq!(payload.downcast_ref::<&str>(), Some(&"own"));
        assert_eq!(caught(|| passing(are_caught)), Ok(false));
    }

    #[test]
    fn a_panic_of_a_helper_thread_reaches_the_caller() {
        let panicked = caught(|| {
            let quiet = are_caught();
            std::thread::scope(|scope| {
                let helper = scope.spawn(move || helping(quiet, || panic!("of a helper")));
                helper.join().unwrap_or_else(|payload| resume_unwind(payload))
            })
        });
        let panicked = panicked.expect_err("it panics");
        assert_eq!(panicked.message, "of a helper");
        assert!(panicked.place.contains("panics.rs:"), "{panicked}");
    }

    #[test]
    fn a_panic_of_a_naga_writer_names_its_output_language() {
        let at = |place: &str| Panicked { message: "no".to_owned(), place: place.to_owned() };
        let glsl =
            short("/home/me/.cargo/registry/src/mirror-1/naga-30.0.1/src/back/glsl/writer.rs", 7);
        assert_eq!(glsl, "naga-30.0.1/src/back/glsl/writer.rs:7");
        assert_eq!(
            at(&glsl).to_string(),
            "naga panics as it writes GLSL: no (panicked at naga-30.0.1/src/back/glsl/writer.rs:7)"
        );
        for place in ["mine/src/back/glsl.rs:1", "naga-30.0.1/src/front/wgsl/mod.rs:1", ""] {
            assert_eq!(at(place).language(), None, "{place}");
        }
    }
}
