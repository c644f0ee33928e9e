//! Small logs in the formats that are read, for demonstrations and tests.
