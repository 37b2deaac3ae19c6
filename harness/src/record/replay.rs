//! A command that runs a failing case again, as data.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A command that runs a failing case again: environment variables, a program and its arguments.
///
/// `Display` writes the command for a shell.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Replay {
    /// Environment variables, in the order in which messages show them.
    pub variables: Vec<(String, String)>,
    /// `cargo`, `karat`, or the path of another program.
    pub program: String,
    /// The program's arguments.
    pub arguments: Vec<String>,
}

impl fmt::Display for Replay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, value) in &self.variables {
            write!(f, "{name}={} ", quoted(value))?;
        }
        f.write_str(&quoted(&self.program))?;
        self.arguments.iter().try_for_each(|argument| write!(f, " {}", quoted(argument)))
    }
}

fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-:./@,#+=".contains(c);
    // A `#` at the start of a word would begin a comment.
    match word.chars().all(plain) && !word.starts_with('#') {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_where_a_shell_needs_it() {
        let shown = |word: &str| {
            let (program, arguments) =
                ("karat".to_owned(), vec!["test".to_owned(), word.to_owned()]);
            Replay { variables: Vec::new(), program, arguments }.to_string()
        };
        assert_eq!(shown("a::b"), "karat test a::b");
        assert_eq!(shown("it's 1"), "karat test 'it'\\''s 1'");
        assert_eq!(shown("#1"), "karat test '#1'");
    }
}
