# Completion of hadalens for bash, made from its option tables.

_hadalens_commands='@COMMANDS@'

# COMMAND: its options
_hadalens_options()
{
    case $1 in
@OPTIONS@
    esac
}

# COMMAND/OPTION: FILE, FOLDER or VALUE, and words; nothing where no value follows
_hadalens_value()
{
    case $1 in
@VALUES@
    esac
}

_hadalens()
{
    local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} command=${COMP_WORDS[1]} value
    COMPREPLY=()
    # bash parts words at '=': --option=value are three
    if [ "$word" = = ]; then
        word=
    elif [ "$before" = = ]; then
        before=${COMP_WORDS[COMP_CWORD - 2]}
    fi
    if [ "$COMP_CWORD" = 1 ]; then
        COMPREPLY=($(compgen -W "$_hadalens_commands help --help --version --man" -- "$word"))
        return
    fi
    case $command in help | --help | -h | --man)
        [ "$COMP_CWORD" != 2 ] || COMPREPLY=($(compgen -W "$_hadalens_commands" -- "$word"))
        return ;;
    esac
    value=$(_hadalens_value "$command/$before")
    if [ -n "$value" ]; then
        COMPREPLY=($(compgen -W "${value#* }" -- "$word"))
        [ "$value" != "${value#* }" ] || COMPREPLY=()
    fi
    case $value:$word in
    VALUE*) return ;;
    FOLDER*) compopt -o filenames; mapfile -t -O ${#COMPREPLY[@]} COMPREPLY < <(compgen -d -- "$word") ;;
    :-*) COMPREPLY=($(compgen -W "$(_hadalens_options "$command")" -- "$word")) ;;
    *) compopt -o filenames; mapfile -t -O ${#COMPREPLY[@]} COMPREPLY < <(compgen -f -- "$word") ;;
    esac
}

complete -F _hadalens hadalens
