//! The words of buffers in JSON: a list of numbers, or base64 of the words' little-endian bytes, for programs
//! that accept base64. Base64 is half as long, and many times faster to read.

use std::cell::Cell;
use std::fmt;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::Job;

thread_local! {
    /// `true` while Karat writes a job for a program that accepts base64. A thread-local variable is needed
    /// because serde doesn't pass such settings to the fields of a job.
    static PACKED: Cell<bool> = const { Cell::new(false) };
}

impl Job {
    /// Writes the job as a line. If `packed`, words are base64.
    pub(crate) fn line(&self, packed: bool) -> String {
        PACKED.set(packed);
        let line = serde_json::to_string(self);
        PACKED.set(false);
        line.expect("a job is plain data")
    }
}

pub(super) fn serialize<S: Serializer>(words: &[u32], to: S) -> Result<S::Ok, S::Error> {
    match PACKED.get() {
        true => {
            let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
            to.serialize_str(&STANDARD.encode(bytes))
        }
        false => words.serialize(to),
    }
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<u32>, D::Error> {
    from.deserialize_any(Words)
}

/// Reads the words of each output.
pub(super) fn all<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Vec<u32>>, D::Error> {
    #[derive(Deserialize)]
    struct One(#[serde(deserialize_with = "deserialize")] Vec<u32>);
    let all: Vec<One> = Vec::deserialize(from)?;
    Ok(all.into_iter().map(|one| one.0).collect())
}

struct Words;

impl<'de> Visitor<'de> for Words {
    type Value = Vec<u32>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of u32 numbers, or their bytes in base64")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
        let bytes = STANDARD.decode(text).map_err(E::custom)?;
        let words = bytes.chunks_exact(4);
        if !words.remainder().is_empty() {
            return Err(E::custom(format!(
                "the base64 text has {} bytes, which isn't a multiple of 4",
                bytes.len()
            )));
        }
        Ok(words.map(|word| u32::from_le_bytes(word.try_into().expect("four"))).collect())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut all: A) -> Result<Self::Value, A::Error> {
        let mut words = Vec::with_capacity(all.size_hint().unwrap_or(0));
        while let Some(word) = all.next_element()? {
            words.push(word);
        }
        Ok(words)
    }
}

#[cfg(test)]
mod tests {
    use crate::job::{Answer, Job, Reply, Resource};

    const JOB: &str = r#"{"jobs": 1, "id": 7, "resources": [{"buffer": {"words": [1, 4294967295]}}], "outputs": [0], "seconds": 1.0,
        "work": {"passes": []}}"#;

    #[test]
    fn words_are_numbers_or_base64() {
        let job: Job = serde_json::from_str(JOB).expect("a job");
        let (plain, packed) = (job.line(false), job.line(true));
        assert!(
            plain.contains("[1,4294967295]") && packed.contains("\"AQAAAP////8=\""),
            "{packed}"
        );
        for line in [plain, packed] {
            let read: Job = serde_json::from_str(&line).expect("a job");
            let [Resource::Buffer { words }] = &*read.resources else { panic!("{line}") };
            assert_eq!(*words, [1, u32::MAX]);
        }
        let read = |reply: &str| {
            serde_json::from_str::<Answer>(&format!(r#"{{"id": 7, "reply": {{"done": {reply}}}}}"#))
        };
        let done = read(r#"["AQAAAP////8=", [5]]"#).expect("an answer").reply;
        assert_eq!(done, Reply::Done(vec![vec![1, u32::MAX], vec![5]]));
        for wrong in [r#"["AQAAAA"]"#, r#"["AQAA"]"#, r#"["?"]"#, "[4294967296]", "[[-1]]"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
