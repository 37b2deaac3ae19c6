//! The files that `karat init` changes in a web project. `package.json` gets a script, and `karat.toml` gets a setting
//! that requires Tint.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use karat::unstable::diagnostic::shown;
use karat::unstable::tint::Tint;
use serde_json::Value;

use crate::cli::table::{DIM, GOOD};

const SCRIPT: &str = "test:shaders";

const FILE: &str = "package.json";

/// The npm package that has Tint, as a part of Dawn.
const TINT: &str = "webgpu";

/// Adds the script and the setting to a project with a `package.json`. Other projects stay unchanged.
pub(super) fn adapt(folder: &Path, out: &mut dyn Write) -> anyhow::Result<()> {
    let whole = folder.canonicalize()?;
    let Some(root) = whole.ancestors().find(|folder| folder.join(FILE).is_file()) else {
        return Ok(());
    };
    let below = whole.strip_prefix(root).unwrap_or(&whole);
    let below = if below.as_os_str().is_empty() { Path::new(".") } else { below };
    add_script(&root.join(FILE), &shown(below), out)?;
    ask_for_tint(folder, (&whole, &root.join(FILE)), out)
}

/// Checks if the `package.json` of a folder depends on Karat. If so, `npm ci` installs Karat.
pub(super) fn brings_karat(folder: &Path) -> bool {
    let text = std::fs::read_to_string(folder.join(FILE)).unwrap_or_default();
    let manifest: Value = serde_json::from_str(&text).unwrap_or_default();
    has(&manifest, "karat")
}

fn has(manifest: &Value, package: &str) -> bool {
    let kinds = ["dependencies", "devDependencies", "optionalDependencies"];
    kinds.iter().any(|kind| manifest[kind].get(package).is_some())
}

/// Adds the script [`SCRIPT`], unless the file has a script of that name.
fn add_script(file: &Path, shaders: &str, out: &mut dyn Write) -> anyhow::Result<()> {
    let name = shown(file);
    let text = std::fs::read_to_string(file).with_context(|| format!("`{name}`"))?;
    let Ok(manifest) = serde_json::from_str::<Value>(&text) else {
        writeln!(out, "{DIM}{name} isn't valid JSON, so Karat adds no script{DIM:#}")?;
        return Ok(());
    };
    if !manifest.is_object() || !matches!(manifest["scripts"], Value::Null | Value::Object(_)) {
        writeln!(out, "{DIM}{name} isn't a package.json of npm, so Karat adds no script{DIM:#}")?;
        return Ok(());
    }
    if manifest["scripts"][SCRIPT].is_string() {
        return Ok(());
    }
    let command = format!("karat test {shaders}");
    let mut wanted = manifest.clone();
    wanted["scripts"][SCRIPT] = command.clone().into();
    let added = inserted(&text, &format!("{}: {}", Value::from(SCRIPT), Value::from(&*command)));
    match added.filter(|added| serde_json::from_str::<Value>(added).is_ok_and(|new| new == wanted))
    {
        Some(added) => {
            std::fs::write(file, added).with_context(|| format!("`{name}`"))?;
            writeln!(out, "{GOOD}added{GOOD:#} `npm run {SCRIPT}` to {name}")?;
        }
        None => {
            writeln!(out, "{DIM}add to the scripts of {name}: \"{SCRIPT}\": \"{command}\"{DIM:#}")?
        }
    }
    Ok(())
}

/// Returns the file's text with one more member of `scripts`, in the author's layout. Returns `None` if the layout
/// isn't clear. The function doesn't parse the file, and may find the wrong `scripts`, so the caller parses the new
/// text and checks it.
fn inserted(text: &str, member: &str) -> Option<String> {
    let scripts = text.find("\"scripts\"");
    let open = match scripts {
        Some(at) => at + text[at..].find('{')?,
        None => text.find('{')?,
    };
    let rest = &text[open + 1..];
    // The new member copies the layout of the next member: on a new line, or on the same line.
    let blank: String = rest.chars().take_while(|c| c.is_whitespace()).collect();
    let is_empty = rest.trim_start().starts_with('}');
    let comma = if is_empty { "" } else { "," };
    let own = match scripts {
        Some(_) => member.to_owned(),
        None => format!("\"scripts\": {{ {member} }}"),
    };
    let (before, after) = match is_empty {
        true => (" ", if blank.contains('\n') { "" } else { " " }),
        false => (&*blank, ""),
    };
    Some(format!("{}{before}{own}{comma}{after}{rest}", &text[..=open]))
}

/// Writes a setting into `karat.toml` that makes a shader invalid if Tint rejects it. Firefox uses naga, but Chrome and
/// Edge use Tint.
fn ask_for_tint(
    folder: &Path,
    (whole, manifest): (&Path, &Path),
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let file = folder.join("karat.toml");
    let known = match std::fs::read_to_string(&file) {
        Ok(text) => text,
        Err(none) if none.kind() == std::io::ErrorKind::NotFound => String::new(),
        Err(error) => return Err(error).with_context(|| format!("`{}`", file.display())),
    };
    if known.contains("[compilers]") {
        return Ok(());
    }
    // Only `package.json` counts: another developer's machine may lack the Tint of this machine.
    let text = std::fs::read_to_string(manifest).unwrap_or_default();
    let manifest: Value = serde_json::from_str(&text).unwrap_or_default();
    if !has(&manifest, TINT) {
        writeln!(
            out,
            "{DIM}the tests don't require Chrome's compiler, because {FILE} doesn't list this compiler: run `npm install --save-dev {TINT}`, and then `karat init`{DIM:#}"
        )?;
        return Ok(());
    }
    // Without Tint, a package that requires Tint fails. The first run should pass.
    if let Err(missing) = Tint::beside(whole, true) {
        let remedy = &missing.remedy;
        writeln!(
            out,
            "{DIM}the tests don't require Chrome's compiler: {missing}; {remedy}, and run `karat init` again{DIM:#}"
        )?;
        return Ok(());
    }
    let blank = if known.is_empty() { "" } else { "\n" };
    let asked = "# Chrome, Edge and Node compile WGSL with Tint: a module that Tint rejects isn't valid.\n\
                 [compilers]\nrequire = [\"tint\"]\n";
    std::fs::write(&file, format!("{known}{blank}{asked}"))
        .with_context(|| format!("`{}`", file.display()))?;
    writeln!(out, "{GOOD}wrote{GOOD:#} {}: each module must be valid for Tint", file.display())?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_added_npm_script_is_formatted_like_the_others() {
        for (text, expected) in [
            ("{}\n", "{ \"scripts\": { \"test:shaders\": \"karat test .\" } }\n"),
            (
                "{\n  \"name\": \"a\"\n}\n",
                "{\n  \"scripts\": { \"test:shaders\": \"karat test .\" },\n  \"name\": \"a\"\n}\n",
            ),
            (
                "{\n  \"scripts\": {\n    \"dev\": \"vite\"\n  }\n}\n",
                "{\n  \"scripts\": {\n    \"test:shaders\": \"karat test .\",\n    \"dev\": \"vite\"\n  }\n}\n",
            ),
            ("{ \"scripts\": {} }", "{ \"scripts\": { \"test:shaders\": \"karat test .\" } }"),
        ] {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let file = folder.path().join(FILE);
            std::fs::write(&file, text).expect("written");
            let mut said = Vec::new();
            add_script(&file, ".", &mut said).expect("a script");
            assert_eq!(std::fs::read_to_string(&file).expect("it is there"), expected, "{text}");
            add_script(&file, ".", &mut said).expect("a script");
            assert_eq!(std::fs::read_to_string(&file).expect("it is there"), expected, "{text}");
        }
    }

    #[test]
    fn an_unusual_package_json_is_not_edited() {
        for (text, expected) in [
            ("{ \"scripts\"", "isn't valid JSON"),
            ("[]", "isn't a package.json of npm"),
            ("{ \"scripts\": 3 }", "isn't a package.json of npm"),
            ("{ \"scripts\": [] }", "isn't a package.json of npm"),
            // The first braces after the word `scripts` don't belong to the scripts.
            (
                "{ \"files\": [\"scripts\"], \"config\": { \"a\": 1 }, \"scripts\": { \"a\": \"b\" } }",
                "add to the scripts of",
            ),
        ] {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let file = folder.path().join(FILE);
            std::fs::write(&file, text).expect("written");
            let mut said = Vec::new();
            add_script(&file, "shaders", &mut said).expect("a line of advice");
            let now = std::fs::read_to_string(&file).expect("it is there");
            let said = String::from_utf8(said).expect("text");
            assert_eq!(now, text, "{said}");
            assert!(said.contains(expected), "{text}: {said}");
        }
    }
}
