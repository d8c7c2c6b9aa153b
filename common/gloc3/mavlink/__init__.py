"""The MAVLink link: codec, endpoints, and one file without I/O for each microservice."""
