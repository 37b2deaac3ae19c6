//! Times the validation of the whole shader library by naga alone, and by naga and Tint.

use shaders::PBR;

use super::{STARTS, Spread, spawn};

pub(super) fn run() {
    println!("\nthe library by naga alone and by both compilers, process start to verdict [s]");
    let (mut naga, mut both, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..STARTS {
        let (alone, said) = spawn("valid", &[("KARAT_TINT", "off")]);
        assert!(said.contains("wasn't asked"), "{said}");
        let (asked, said) = spawn("valid", &[]);
        if !said.contains("Tint accepts") {
            return println!("  {said}");
        }
        let (alone, asked) = (alone.as_secs_f64(), asked.as_secs_f64());
        naga.push(alone);
        both.push(asked);
        ratios.push(asked / alone);
    }
    println!("  naga           {}", Spread::of(naga));
    println!("  naga and Tint  {}", Spread::of(both));
    println!("  ratio          {}", Spread::of(ratios));
}

/// Validates the library, and prints Tint's verdict.
pub(super) fn child() {
    print!("{}", PBR.is_valid().opinion);
}
