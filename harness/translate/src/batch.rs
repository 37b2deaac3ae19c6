//! Checks several translations with one process of a tool, such as glslang.
//!
//! glslang spends most of its time on parsing GLSL's built-in declarations, before it reads a shader. One process
//! with ten files takes as long as two processes with one file each.

use std::io;
use std::process::Command;

use crate::child::{self, End};
use crate::{Stage, Target, Tool, Translation, Validation, Verdict};

/// The maximum number of files that one process checks. If the process rejects one of its files, Karat checks all of
/// them again, each in a process of its own.
const FILES: usize = 32;

impl Tool {
    /// Checks several translations with as few processes as possible. The results are the same as from a call of
    /// [`validate`](Self::validate) for each translation.
    ///
    /// # Errors
    /// An element is an error if [`validate`](Self::validate) would return an error for this translation.
    pub fn validate_all(&self, translations: &[&Translation]) -> Vec<io::Result<Validation>> {
        let mut said: Vec<Option<io::Result<Validation>>> =
            translations.iter().map(|_| None).collect();
        for (target, stage) in kinds(translations) {
            let of_kind = |index: &usize| kind(translations[*index]) == Some((target, stage));
            let indices: Vec<usize> = (0..translations.len()).filter(of_kind).collect();
            for indices in indices.chunks(FILES) {
                let batch: Vec<&Translation> = indices.iter().map(|at| translations[*at]).collect();
                if self.all_valid(target, &batch) {
                    for (index, translation) in indices.iter().zip(batch) {
                        said[*index] = Some(Ok(self.says_valid(translation)));
                    }
                }
            }
        }
        let each = said.into_iter().zip(translations);
        each.map(|(said, one)| said.unwrap_or_else(|| self.validate(one))).collect()
    }

    /// Checks if one process accepts all translations of the batch. If this function returns `false`, the caller checks
    /// each translation separately by [`validate`](Self::validate).
    fn all_valid(&self, target: Target, batch: &[&Translation]) -> bool {
        batch.len() > 1 && self.judges_files(target) && self.find_nothing(batch).unwrap_or(false)
    }

    fn find_nothing(&self, batch: &[&Translation]) -> io::Result<bool> {
        let folder = tempfile::tempdir()?;
        let names: Vec<String> =
            (0..batch.len()).map(|n| format!("{n}.{}", batch[n].target.extension())).collect();
        for (translation, name) in batch.iter().zip(&names) {
            std::fs::write(folder.path().join(name), translation.code.bytes())?;
        }
        let Some(mut command) = self.command(batch[0], &names) else { return Ok(false) };
        let ran = child::run(command.current_dir(folder.path()))?;
        // The tool prints the name of each file that it has read.
        let read = |name: &String| ran.output.lines().any(|line| line == name);
        Ok(ran.end == End::Good && names.iter().all(read))
    }

    fn command(&self, first: &Translation, files: &[String]) -> Option<Command> {
        let mut command = Command::new(self.program()?);
        let mut arguments = self.arguments(first)?;
        arguments.pop(); // the file
        command.args(arguments).args(files);
        Some(command)
    }

    /// The [`Validation`] of a valid translation, equal to the result of [`validate`](Self::validate).
    fn says_valid(&self, translation: &Translation) -> Validation {
        let arguments = self.arguments(translation).unwrap_or_default();
        self.says(format!("{} {}", self.name(), arguments.join(" ")), Verdict::Valid)
    }
}

fn kind(translation: &Translation) -> Option<(Target, Stage)> {
    match &*translation.entry_points {
        [one] => Some((translation.target, one.stage)),
        _ => None,
    }
}

fn kinds(translations: &[&Translation]) -> Vec<(Target, Stage)> {
    let mut kinds = Vec::new();
    for kind in translations.iter().filter_map(|translation| kind(translation)) {
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    kinds
}
