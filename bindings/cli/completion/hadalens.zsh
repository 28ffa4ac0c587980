#compdef hadalens
# Completion of hadalens for zsh, made from its option tables.

_hadalens_commands()
{
    local -a commands=(
@COMMANDS@
    )
    _describe -t commands command commands
}

# words that stand for themselves, and files or folders beside them
_hadalens_words() { (( $# )) && _values value "$@" || _message 'a value' }
_hadalens_files() { (( $# )) && _alternative "words:word:($*)" 'files:file:_files' || _files }
_hadalens_folders() { (( $# )) && _alternative "words:word:($*)" 'folders:folder:_files -/' || _files -/ }

_hadalens()
{
    local context state state_descr line curcontext=$curcontext
    typeset -A opt_args
    _arguments -C '(- 1 *)'{-h,--help}'[print the commands]' '(- 1 *)'{-V,--version}'[print the version]' \
        '(- 1 *)--man[print a manual page]:command:_hadalens_commands' \
        '1:command:_hadalens_commands' '*::argument:->arguments' && return
    [[ $state = arguments ]] || return
    curcontext=${curcontext%:*:*}:hadalens-$words[1]:
    case $words[1] in
    help) _arguments '1:command:_hadalens_commands' ;;
@ARGUMENTS@
    esac
}

_hadalens "$@"
