"""The command line: one file a group of verbs; each verb parses, makes one call, prints (docs/reference/scenectl.md)."""
