use super::*;

/// naga's IR of a text, without spans.
fn ir(text: &str) -> String {
    let module = wgsl::parse_str(text).unwrap_or_else(|error| panic!("{error}\n{text}"));
    let debug = format!("{module:?}");
    let mut parts = debug.split("Span { start: ");
    let mut without: String = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        without.push_str(part.split_once(" }").expect("a span has an end").1);
    }
    without
}

/// The linker can rename every declaration of a module. The test shows that only names change in naga's IR, so the
/// linker finds each use of a name, and changes nothing else.
// Lesson 51: each name of the library
#[test]
fn renamed_modules_are_the_same_programs() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut renamed = 0;
    // In the published crate, the folder `../shaders` doesn't exist, so the test reads fewer shaders.
    let published = root.join(".cargo_vcs_info.json").exists();
    let (many, least) =
        if published { ("tests/strangers/shaders", 10) } else { ("../shaders", 400) };
    for folder in [root.join(many), root.join("examples/shaders")] {
        let package = Package::open(folder).expect("a folder");
        for module in package.modules().expect("readable") {
            let linked = package.link_module(&module).expect("valid");
            // Linked text has no imports.
            let plain = Package::from_source("m", linked.text());
            let other = plain.link_renamed("").expect("it is plain");
            assert_ne!(other.text(), linked.text(), "{module}");
            let mut expected = ir(linked.text());
            let mut found = ir(other.text());
            for (name, author) in &other.names {
                assert_ne!(name, author, "{module}");
                renamed += 1;
                found = found.replace(&format!("\"{name}\""), &format!("\"{author}\""));
            }
            // A new name may have another position in a sorted list.
            for text in [&mut expected, &mut found] {
                text.retain(|c| !c.is_whitespace());
            }
            assert!(expected == found, "{module}:\n{}", other.text());
        }
    }
    assert!(renamed > least, "{renamed}");
}
