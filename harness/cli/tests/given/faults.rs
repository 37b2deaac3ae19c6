//! Builds the data of a failure for a record that a test writes.

use serde_json::{Value, json};

/// The data of a failure with this message. A line `on PATH: ...` of the message begins the failures on a path, and a
/// line `replay: ...` ends a failing case.
pub(crate) fn fault(message: &str) -> Value {
    let first = message.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    let mut paths: Vec<Value> = Vec::new();
    let begin = |path: &str| json!({ "adapter": { "path": path, "name": "", "driver": "", "software": true } });
    for line in message.lines() {
        if let Some((path, _)) = line.strip_prefix("on ").and_then(|on| on.split_once(':')) {
            paths.push(begin(path));
        }
        let Some(command) = line.trim_start().strip_prefix("replay: ") else { continue };
        let words = shell_words::split(command).expect("a command");
        // Without such a heading, the replay command names the path.
        let named = words.iter().find_map(|word| word.strip_prefix("KARAT_PATHS="));
        let begun = |paths: &[Value]| {
            paths.iter().any(|own| own["adapter"]["path"] == *named.unwrap_or_default())
        };
        if paths.is_empty() || (named.is_some() && !begun(&paths)) {
            paths.push(begin(named.unwrap_or("vulkan")));
        }
        let set = words.iter().take_while(|word| word.starts_with("KARAT_"));
        let variables: Vec<_> = set.filter_map(|word| word.split_once('=')).collect();
        let rest = &words[variables.len()..];
        let replay =
            json!({ "variables": variables, "program": rest[0], "arguments": rest[1..].to_vec() });
        let own = paths.last_mut().expect("a path");
        let case = if own["worst"].is_null() { "worst" } else { "simplest" };
        own[case] = json!({ "replay": replay });
    }
    json!({ "headline": first.trim_start_matches("error: "), "paths": paths })
}
