"""The whole scene in Mitsuba 3: a second renderer, for comparison, that shares no code with ours between record and film."""
