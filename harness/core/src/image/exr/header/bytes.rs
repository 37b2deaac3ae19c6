//! Reads a header byte by byte.

pub(in crate::image::exr) struct Bytes<'a> {
    pub(in crate::image::exr) rest: &'a [u8],
}

impl<'a> Bytes<'a> {
    pub(in crate::image::exr) fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (taken, rest) =
            self.rest.split_at_checked(count).ok_or("the file ends in the middle of its header")?;
        self.rest = rest;
        Ok(taken)
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        Ok(self.take(N)?.try_into().expect("as many as were taken"))
    }

    pub(super) fn u8(&mut self) -> Result<u8, String> {
        Ok(self.array::<1>()?[0])
    }

    pub(super) fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub(in crate::image::exr) fn i32(&mut self) -> Result<i32, String> {
        Ok(i32::from_le_bytes(self.array()?))
    }

    /// Checks if a list ends at the current byte. If so, skips the zero byte that ends the list.
    pub(super) fn ends(&mut self) -> Result<bool, String> {
        let ends = self.rest.first() == Some(&0);
        if ends || self.rest.is_empty() {
            self.take(1)?;
        }
        Ok(ends)
    }

    /// Reads a name and the zero byte after the name, and returns the name.
    pub(super) fn name(&mut self) -> Result<&'a [u8], String> {
        // The format allows names of 255 bytes.
        let end = self.rest.iter().take(256).position(|byte| *byte == 0);
        let name = self
            .take(end.ok_or("the file has a name that is longer than 255 bytes or has no end")?)?;
        self.take(1)?;
        Ok(name)
    }
}
