#ifndef HADA_TESTS_DEFAULTS_H
#define HADA_TESTS_DEFAULTS_H

/* Declares a struct of options that has its defaults. */
#define DEFAULTS(type, name)                                                                                           \
    type name;                                                                                                         \
    type##_init(&name)

#endif
