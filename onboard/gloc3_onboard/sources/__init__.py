"""Where samplers' data comes from: hardware, another process, or a log; chosen by a URL. Not components, but devices."""
