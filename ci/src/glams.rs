//! `cargo ci glams`: tests that a project can use karat with the vector types of mint and of each glam version for
//! which karat has a feature.

use std::fmt::Write as _;

use anyhow::{Context, Result};

use crate::command;

/// The glam versions, as they appear in the names of karat's features: `glam-029`.
const VERSIONS: [&str; 5] = ["029", "030", "031", "032", "033"];

/// Writes a project into `target/glams`, and runs its tests.
pub(crate) fn run() -> Result<()> {
    let root = command::root();
    let folder = root.join("target/glams");
    let features: Vec<String> =
        VERSIONS.iter().map(|version| format!("\"glam-{version}\"")).collect();
    let mut manifest = format!(
        "[package]\nname = \"glams\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n[workspace]\n\n[dependencies]\nmint = \"0.5\"\n\
         karat = {{ path = {:?}, features = [{}, \"mint\"] }}\n",
        root.join("harness"),
        features.join(", ")
    );
    let mut tests = String::from(MINT);
    for version in VERSIONS {
        let number = version.trim_start_matches('0');
        writeln!(manifest, "glam_{version} = {{ package = \"glam\", version = \"0.{number}\" }}")?;
        tests += &TEST.replace("VERSION", version);
    }
    let write = |name: &str, text: &str| {
        let file = folder.join(name);
        std::fs::create_dir_all(folder.join("src"))?;
        std::fs::write(&file, text).with_context(|| format!("can't write `{}`", file.display()))
    };
    write("Cargo.toml", &manifest)?;
    write("src/lib.rs", &tests)?;
    // With this lock file, the project uses the same versions of crates as this workspace.
    std::fs::copy(root.join("Cargo.lock"), folder.join("Cargo.lock"))?;
    let mut test = command::cargo(&["test", "--manifest-path"]);
    test.arg(folder.join("Cargo.toml")).env("KARAT_PATHS", "cpu");
    command::run(&mut test)
}

/// Tests that use the vector types of one glam version: in a domain, a reference, a texture and a mesh.
const TEST: &str = r#"
#[cfg(test)]
mod glam_VERSION_is_the_engines {
    use glam_VERSION::{DVec3, Mat3, Vec3};
    use karat::prelude::*;

    const TEXT: &str = "@group(0) @binding(0) var ramp: texture_2d<f32>;
                        fn texel(x: u32) -> f32 { return textureLoad(ramp, vec2u(x, 0), 0).y; }
                        fn turned(v: vec3f, k: f32) -> vec3f { return k * v.yzx; }
                        fn applied(m: mat3x3f, v: vec3f) -> vec3f { return m * v; }";

    #[test]
    fn a_first_test() {
        let package = Package::from_source("engine", TEXT);
        let reference = |v: DVec3, k: f64| k * DVec3::new(v.y, v.z, v.x);
        package.function("turned").over((UnitVector.cast::<Vec3>(), 0.0..=2.0)).agrees_with(reference, Ulp(1.0));
        let wrong = |v: DVec3, k: f64| k * v;
        let off = package.function("turned").over((UnitVector.cast::<Vec3>(), 0.0..=2.0));
        assert!(off.unrecorded().try_agrees_with(wrong, Ulp(1.0)).is_err());
        let fixed = Just((Mat3::IDENTITY, Vec3::new(1.0, 2.0, 3.0)));
        package.function("applied").over(fixed).satisfies("is v", |(_, v): (Mat3, Vec3), result: Vec3| v == result);
        let ramp = karat::Texture::from_fn(4, 1, |x, _| Vec3::new(0.0, x as f32, 0.0));
        package.function("texel").with("ramp", ramp).over(Integers(0..=3_u32)).agrees_with(|x: u32| f64::from(x), Ulp(0.0));
        let mesh = karat::draw::Mesh::new(vec![Vec3::X, Vec3::Y, Vec3::Z], vec![0, 1, 2]);
        let _ = mesh.attribute(1, &[Vec3::Z; 3]).attribute(2, &[[0.5_f32; 2]; 3]);
    }
}
"#;

const MINT: &str = r#"
#[cfg(test)]
mod mint_is_the_engines {
    use karat::prelude::*;
    use mint::Vector3;

    #[test]
    fn a_first_test() {
        let package = Package::from_source("engine", "fn turned(v: vec3f) -> vec3f { return v.yzx; }");
        let reference = |v: Vector3<f64>| Vector3 { x: v.y, y: v.z, z: v.x };
        package.function("turned").over(UnitVector.cast::<Vector3<f32>>()).agrees_with(reference, Ulp(0.0));
    }

    #[test]
    fn a_reference_can_use_the_glam_of_karat() {
        let package = Package::from_source("engine", "fn turned(v: vec3f) -> vec3f { return v.yzx; }");
        let reference = |v: karat::glam::DVec3| karat::glam::DVec3::new(v.y, v.z, v.x);
        package.function("turned").over(UnitVector).agrees_with(reference, Ulp(0.0));
    }
}
"#;
