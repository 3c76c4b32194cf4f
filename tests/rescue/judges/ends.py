# per search: how the grant before it ended, and the true new floor
import sys,re,math,collections
src=open('gain.py').read()
g={}
exec('import re,math\nR=4.0\nC=.25\n'+src[src.index('def geo'):src.index('C=0.25')]+src[src.index('def seen'):src.index('tot=')],g)
by=collections.defaultdict(list);Y={}
for l in open(sys.argv[1]):
    w=l.split(None,3)
    if w and w[0]=='Y': Y[w[1]]=l
    elif w and w[0] in 'EP': by[w[1]].append(l)
st=collections.defaultdict(list)
for k,ls in by.items():
    W,D,segs,_=g['geo'](Y[k]);have=set();pos=None;how='first';last=None;lostrun=None
    left=None;tend=None
    for l in ls:
        w=l.split(None,4)
        if w[0]=='P': pos=tuple(map(float,l.split()[3:5]));continue
        if w[3]=='Log' and ' R ' in l:
            m=l.split(' R ')[1]
            if m.startswith('way'): last=m;how='way'
            elif m.startswith('end'): how='blocked' if 'blocked true' in m else 'end'
            elif m.startswith('no way'): how='noway'
        elif 'may drive for' in l: t0=float(w[2])
        elif w[3]=='Heard' and 'Engine(Dock)' in l and pos:
            s=g['seen'](pos,segs,W,D);new=len(s-have)*.0625;have|=s
            if how!='first':
                dur=float(w[2])-t0
                key=how
                if how in('end','blocked'): key=('timeout ' if dur>39 else 'reached ')+('last' if 'last true' in last else 'part')+(' blocked' if how=='blocked' else '')
                st[key].append(new)
            how='none'
for k,v in sorted(st.items()): print('%-26s n %4d  vain(<1 m2) %.2f  mean gain %.1f'%(k,len(v),sum(x<1 for x in v)/len(v),sum(v)/len(v)))
