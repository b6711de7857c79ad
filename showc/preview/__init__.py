"""The preview: a show drawn while its script is written, before it is solved."""
