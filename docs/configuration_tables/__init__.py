"""Tables of the configuration's keys, from the models and classes that read them."""
