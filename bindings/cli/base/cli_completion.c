/* Completion for bash and zsh from the option tables. What a value may be is read from the word that stands for it in
 * the help: small words ("auto|none") are offered, FILE and the like ask for files, FOLDER and DATASET for folders. */
#include "option.h"

#include <stdio.h>
#include <string.h>

typedef struct script {
    FILE *out;
    const hada_cli_command *command;
} script;

/* A part of "FILE|auto|none|LEVEL". */
typedef enum part_kind { PART_END, PART_WORD, PART_FILE, PART_FOLDER, PART_OTHER } part_kind;

static int among(const char *part, size_t length, const char *const *words)
{
    for (; *words; words++)
        if (strlen(*words) == length && !strncmp(*words, part, length))
            return 1;
    return 0;
}

/* The part at *text, which moves behind it. */
static part_kind next_part(const char **text, const char **part, size_t *length)
{
    static const char *const files[] = {"FILE", "MODEL", "MODEL2", NULL};
    static const char *const folders[] = {"FOLDER", "DATASET", "DATASET2", NULL};
    static const char small[] = "abcdefghijklmnopqrstuvwxyz0123456789-";
    *part = *text;
    *length = strcspn(*text, "|");
    *text += *length + ((*text)[*length] == '|');
    if (!*length)
        return PART_END;
    if (strspn(*part, small) == *length)
        return PART_WORD;
    if (among(*part, *length, folders))
        return PART_FOLDER;
    const char *dot = memchr(*part, '.', *length); /* PSF.tif, but not NAME=N,... */
    if (among(*part, *length, files) || (dot && dot[1] >= 'a' && dot[1] <= 'z'))
        return PART_FILE;
    return PART_OTHER;
}

/* What may follow an option: words, and whether files or folders. */
typedef struct values {
    int words, files, folders;
} values;

static values values_of(const char *argument)
{
    values found = {0};
    const char *part;
    size_t length;
    for (part_kind kind; argument && (kind = next_part(&argument, &part, &length)) != PART_END;) {
        found.words += kind == PART_WORD;
        found.files += kind == PART_FILE;
        found.folders += kind == PART_FOLDER;
    }
    return found;
}

/* The words, each behind a blank. */
static void put_words(FILE *out, const char *argument)
{
    const char *part;
    size_t length;
    for (part_kind kind; (kind = next_part(&argument, &part, &length)) != PART_END;)
        if (kind == PART_WORD)
            fprintf(out, " %.*s", (int)length, part);
}

static void put_bash_name(void *user, const hada_cli_option *option)
{
    script *to = user;
    if (option->kind != HADA_OPTION_GROUP)
        fprintf(to->out, " --%s", option->name);
}

/* A line of a `case` on COMMAND/OPTION: what stands for the value. */
static void put_bash_value(void *user, const hada_cli_option *option)
{
    script *to = user;
    if (option->kind == HADA_OPTION_GROUP || !option->argument)
        return;
    const values found = values_of(option->argument);
    fprintf(to->out, "    %s/--%s", to->command->name, option->name);
    if (option->letter)
        fprintf(to->out, " | %s/-%c", to->command->name, option->letter);
    fprintf(to->out, ") echo '%s", found.files ? "FILE" : found.folders ? "FOLDER" : "VALUE");
    put_words(to->out, option->argument);
    fputs("' ;;\n", to->out);
}

static void print_bash(FILE *out)
{
    script to = {out, NULL};
    fprintf(out,
            "# Completion of hadalens %s for bash, written by the program from its option tables.\n\n"
            "_hadalens_commands='",
            HADALENS_VERSION);
    for (int i = 0; hada_cli_commands[i]; i++)
        fprintf(out, "%s%s", i ? " " : "", hada_cli_commands[i]->name);
    fputs("'\n\n# COMMAND: its options\n_hadalens_options()\n{\n    case $1 in\n", out);
    for (int i = 0; (to.command = hada_cli_commands[i]); i++) {
        fprintf(out, "    %s) echo '", to.command->name);
        hada_cli_each_option(to.command, put_bash_name, &to);
        fputs(" ' ;;\n", out);
    }
    fputs("    esac\n}\n\n# COMMAND/OPTION: FILE, FOLDER or VALUE, and words; nothing where no value follows\n"
          "_hadalens_value()\n{\n    case $1 in\n",
          out);
    for (int i = 0; (to.command = hada_cli_commands[i]); i++)
        hada_cli_each_option(to.command, put_bash_value, &to);
    fputs(
        "    esac\n}\n\n"
        "_hadalens()\n{\n"
        "    local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} command=${COMP_WORDS[1]} value\n"
        "    COMPREPLY=()\n"
        "    # bash parts words at '=': --option=value are three\n"
        "    if [ \"$word\" = = ]; then\n"
        "        word=\n"
        "    elif [ \"$before\" = = ]; then\n"
        "        before=${COMP_WORDS[COMP_CWORD - 2]}\n"
        "    fi\n"
        "    if [ \"$COMP_CWORD\" = 1 ]; then\n"
        "        COMPREPLY=($(compgen -W \"$_hadalens_commands help --help --version --man\" -- \"$word\"))\n"
        "        return\n"
        "    fi\n"
        "    case $command in help | --help | -h | --man)\n"
        "        [ \"$COMP_CWORD\" != 2 ] || COMPREPLY=($(compgen -W \"$_hadalens_commands\" -- \"$word\"))\n"
        "        return ;;\n"
        "    esac\n"
        "    value=$(_hadalens_value \"$command/$before\")\n"
        "    if [ -n \"$value\" ]; then\n"
        "        COMPREPLY=($(compgen -W \"${value#* }\" -- \"$word\"))\n"
        "        [ \"$value\" != \"${value#* }\" ] || COMPREPLY=()\n"
        "    fi\n"
        "    case $value:$word in\n"
        "    VALUE*) return ;;\n"
        "    FOLDER*) compopt -o filenames; mapfile -t -O ${#COMPREPLY[@]} COMPREPLY < <(compgen -d -- \"$word\") ;;\n"
        "    :-*) COMPREPLY=($(compgen -W \"$(_hadalens_options \"$command\")\" -- \"$word\")) ;;\n"
        "    *) compopt -o filenames; mapfile -t -O ${#COMPREPLY[@]} COMPREPLY < <(compgen -f -- \"$word\") ;;\n"
        "    esac\n"
        "}\n\n"
        "complete -F _hadalens hadalens\n",
        out);
}

/* Text between quotes of zsh, where _arguments takes brackets and colons for its own. */
static void put_zsh_text(FILE *out, const char *text)
{
    for (; *text; text++) {
        if (*text == '\'')
            fputs("'\\'", out);
        else if (strchr("[]:\\", *text))
            fputc('\\', out);
        fputc(*text, out);
    }
}

static void put_zsh_option(void *user, const hada_cli_option *option)
{
    script *to = user;
    if (option->kind == HADA_OPTION_GROUP)
        return;
    const char *many = option->kind == HADA_OPTION_TEXTS ? "*" : "";
    fputs(" \\\n        ", to->out);
    if (option->letter && *many)
        fprintf(to->out, "'*'{-%c,--%s%s}'[", option->letter, option->name, option->argument ? "=" : "");
    else if (option->letter)
        fprintf(to->out, "'(-%c --%s)'{-%c,--%s%s}'[", option->letter, option->name, option->letter, option->name,
                option->argument ? "=" : "");
    else
        fprintf(to->out, "'%s--%s%s[", many, option->name, option->argument ? "=" : "");
    put_zsh_text(to->out, option->help);
    fputc(']', to->out);
    if (option->argument) {
        const values found = values_of(option->argument);
        fputc(':', to->out);
        put_zsh_text(to->out, option->argument);
        /* a blank before a function: it is called as it stands */
        fprintf(to->out, ": _hadalens_%s", found.files ? "files" : found.folders ? "folders" : "words");
        put_words(to->out, option->argument);
    }
    fputc('\'', to->out);
}

static void print_zsh(FILE *out)
{
    script to = {out, NULL};
    fprintf(out,
            "#compdef hadalens\n"
            "# Completion of hadalens %s for zsh, written by the program from its option tables.\n\n"
            "_hadalens_commands()\n{\n    local -a commands=(\n",
            HADALENS_VERSION);
    for (int i = 0; hada_cli_commands[i]; i++) {
        fprintf(out, "        '%s:", hada_cli_commands[i]->name);
        put_zsh_text(out, hada_cli_commands[i]->summary);
        fputs("'\n", out);
    }
    fputs(
        "    )\n    _describe -t commands command commands\n}\n\n"
        "# words that stand for themselves, and files or folders beside them\n"
        "_hadalens_words() { (( $# )) && _values value \"$@\" || _message 'a value' }\n"
        "_hadalens_files() { (( $# )) && _alternative \"words:word:($*)\" 'files:file:_files' || _files }\n"
        "_hadalens_folders() { (( $# )) && _alternative \"words:word:($*)\" 'folders:folder:_files -/' || _files -/ }\n\n"
        "_hadalens()\n{\n"
        "    local context state state_descr line curcontext=$curcontext\n"
        "    typeset -A opt_args\n"
        "    _arguments -C '(- 1 *)'{-h,--help}'[print the commands]' '(- 1 *)'{-V,--version}'[print the version]' \\\n"
        "        '(- 1 *)--man[print a manual page]:command:_hadalens_commands' \\\n"
        "        '1:command:_hadalens_commands' '*::argument:->arguments' && return\n"
        "    [[ $state = arguments ]] || return\n"
        "    curcontext=${curcontext%:*:*}:hadalens-$words[1]:\n"
        "    case $words[1] in\n"
        "    help) _arguments '1:command:_hadalens_commands' ;;\n",
        out);
    for (int i = 0; (to.command = hada_cli_commands[i]); i++) {
        fprintf(out, "    %s)\n        _arguments -S", to.command->name);
        hada_cli_each_option(to.command, put_zsh_option, &to);
        fputs(" \\\n        '*:file:_files' ;;\n", out);
    }
    fputs("    esac\n}\n\n_hadalens \"$@\"\n", out);
}

int hada_cli_print_completion(const char *shell, FILE *out)
{
    if (!strcmp(shell, "bash"))
        print_bash(out);
    else if (!strcmp(shell, "zsh"))
        print_zsh(out);
    else
        return 0;
    return 1;
}
